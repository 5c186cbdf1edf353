/*
 * For boards without converters: outputs wired to inputs, each with the errors of real ones. Outputs go in steps of 16 mV,
 * as a VDAC8 in its 4.08 V range; gain and offset are off by what its data sheet allows, differently on each channel.
 */
#ifndef LOOP_H
#define LOOP_H

#include <stdint.h>

void loop_set(unsigned channel, int32_t microvolts);
int32_t loop_read(unsigned channel);

/* The first channel's output is off by so much more from now on, which the errors below do not tell. */
void loop_drift(int32_t microvolts);

/* What the output's pin is at, and the errors that a calibration of the loop would find. */
int32_t loop_pin(unsigned channel);
uint32_t loop_gain_ppm(unsigned channel);
int32_t loop_offset_uv(unsigned channel);

#endif
