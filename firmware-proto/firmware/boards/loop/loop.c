#include "loop.h"

#include "bench_proto.h"

#define STEP_UV 16000
#define NOISE_UV 500 /* largest deviation of a measurement */

static const struct {
    int32_t gain_ppm;
    int32_t offset_uv;
} ERRORS[BP_CHANNELS] = {{985000, 9000}, {1012000, -6000}, {995000, 4000}, {1020000, 11000}};

static int32_t pin_uv[BP_CHANNELS];
static int32_t drift_uv[BP_CHANNELS];
static uint32_t noise = 1;

void loop_set(unsigned channel, int32_t microvolts)
{
    const int32_t stepped = (microvolts + STEP_UV / 2) / STEP_UV * STEP_UV;
    pin_uv[channel] = (int32_t)((int64_t)stepped * ERRORS[channel].gain_ppm / 1000000) + ERRORS[channel].offset_uv
        + drift_uv[channel];
}

void loop_drift(int32_t microvolts) { drift_uv[0] = microvolts; }

int32_t loop_read(unsigned channel)
{
    /* A linear congruential generator (Numerical Recipes' constants): repeats, and is noise enough for a converter. */
    noise = noise * 1664525u + 1013904223u;
    return pin_uv[channel] + (int32_t)((noise >> 16) % (2 * NOISE_UV + 1)) - NOISE_UV;
}

int32_t loop_pin(unsigned channel) { return pin_uv[channel]; }
uint32_t loop_gain_ppm(unsigned channel) { return (uint32_t)ERRORS[channel].gain_ppm; }
int32_t loop_offset_uv(unsigned channel) { return ERRORS[channel].offset_uv; }
