/*
 * What the application asks of a board: four outputs, four inputs, a serial line, a clock, a supply, a hardware watchdog.
 * One folder in boards/ implements it, and is linked with app.c and ../c/bench_proto.c. No function may block, but
 * board_idle, for a millisecond at most.
 */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bench_proto.h"

/* Starts the hardware with all outputs at 0 V. */
void board_init(void);

/* Microseconds since the reset; never runs back. To be called at least once a second. */
uint64_t board_time_us(void);

/* Sets an output, 0 <= microvolts <= APP_RANGE_UV, to the nearest step that the converter has. */
void board_dac_set(unsigned channel, int32_t microvolts);

/* Measures an output through the input that is wired to it, microvolts. */
int32_t board_adc_read(unsigned channel);

/* Whether the supply is high enough for the outputs to be true. */
bool board_supply_good(void);

/* Whether the last reset came from a supply that was too low. */
bool board_reset_by_brown_out(void);

/* What the board's memory has of the loop from an output to its input; gain 1 and offset 0 if it was never calibrated. */
bp_calibration board_calibration(unsigned channel);

/* The next byte received, or -1 when there is none. */
int board_serial_read(void);

/* Sends all of it, or nothing when the transmit buffer has no room. */
bool board_serial_write(const uint8_t *bytes, size_t length);

/* The hardware watchdog resets a board that does not feed it. Start it last. */
void board_watchdog_start(void);
void board_watchdog_feed(void);

/* For a lamp or a trace. */
typedef enum { BOARD_APPLIED, BOARD_ARMED, BOARD_DISARMED, BOARD_TRIPPED } board_event;
void board_signal(board_event event);

/* Sleeps until a byte came, for a millisecond at most; or returns at once. */
void board_idle(void);

#endif
