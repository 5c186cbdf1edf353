/*
 * The application as a Linux program, in real time. Its serial line is standard input and output; it ends when the other side
 * closes it. With the environment variable BOARD_TRACE naming a file, it appends there what the outputs and their pins did, and when. With
 * BOARD_CALIBRATED it has the true errors of its outputs in its memory, as a board that was calibrated once. With BOARD_DRIFT_UV its
 * throttle output is off by so many microvolts more, as that of a board which has drifted since.
 */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include "board.h"
#include "loop.h"

static FILE *trace;
static uint64_t reset_us;
static int32_t dac_uv[BP_CHANNELS];

static uint64_t monotonic_us(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u;
}

void board_init(void)
{
    const char *path = getenv("BOARD_TRACE");
    const char *drift_uv = getenv("BOARD_DRIFT_UV");
    reset_us = monotonic_us();
    if (drift_uv != NULL) {
        loop_drift((int32_t)strtol(drift_uv, NULL, 10));
    }
    if (path != NULL && (trace = fopen(path, "a")) == NULL) {
        perror(path);
        exit(2);
    }
    if (trace != NULL) {
        fprintf(trace, "0 reset\n");
        fflush(trace);
    }
    (void)fcntl(STDIN_FILENO, F_SETFL, fcntl(STDIN_FILENO, F_GETFL) | O_NONBLOCK);
}

uint64_t board_time_us(void) { return monotonic_us() - reset_us; }

void board_dac_set(unsigned channel, int32_t microvolts)
{
    const bool changed = dac_uv[channel] != microvolts;
    loop_set(channel, microvolts);
    if (trace != NULL && changed) {
        const uint64_t now_us = board_time_us();
        fprintf(trace, "%" PRIu64 " dac %u %" PRId32 "\n", now_us, channel, microvolts);
        fprintf(trace, "%" PRIu64 " pin %u %" PRId32 "\n", now_us, channel, loop_pin(channel));
        fflush(trace);
    }
    dac_uv[channel] = microvolts;
}

int32_t board_adc_read(unsigned channel) { return loop_read(channel); }
bool board_supply_good(void) { return true; }
bool board_reset_by_brown_out(void) { return false; }

bp_calibration board_calibration(unsigned channel)
{
    if (getenv("BOARD_CALIBRATED") != NULL) {
        return (bp_calibration){.gain_ppm = loop_gain_ppm(channel), .offset_uv = loop_offset_uv(channel)};
    }
    return (bp_calibration){.gain_ppm = 1000000, .offset_uv = 0};
}

int board_serial_read(void)
{
    static uint8_t buffer[256];
    static size_t length, at;
    if (at == length) {
        const ssize_t got = read(STDIN_FILENO, buffer, sizeof buffer);
        if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR)) {
            exit(0);
        }
        at = 0;
        length = got < 0 ? 0 : (size_t)got;
    }
    return at < length ? buffer[at++] : -1;
}

bool board_serial_write(const uint8_t *bytes, size_t length)
{
    while (length > 0) {
        const ssize_t put = write(STDOUT_FILENO, bytes, length);
        if (put < 0 && errno != EAGAIN && errno != EINTR) {
            exit(0);
        }
        if (put > 0) {
            bytes += put;
            length -= (size_t)put;
        }
    }
    return true;
}

/* The operating system ends what does not end itself; there is nothing to feed. */
void board_watchdog_start(void) {}
void board_watchdog_feed(void) {}

void board_signal(board_event event)
{
    static const char *const NAMES[] = {"applied", "armed", "disarmed", "tripped"};
    if (trace != NULL) {
        fprintf(trace, "%" PRIu64 " %s\n", board_time_us(), NAMES[event]);
        fflush(trace);
    }
}

void board_idle(void)
{
    struct pollfd line = {.fd = STDIN_FILENO, .events = POLLIN};
    (void)poll(&line, 1, 1);
}
