/*
 * The application: carries out the host's commands (docs/protocol.md) on a board (board.h), and keeps the outputs at zero
 * unless an armed board hears from its host.
 */
#ifndef APP_H
#define APP_H

#include "board.h"

#define APP_RANGE_UV 3300000      /* outputs go from 0 V to the transmitter's 3.3 V */
#define APP_SLEW_UV_PER_US 1000u  /* full range in 3.3 ms: within the 5 ms that an answer may take */
#define APP_MISMATCH_UV 100000    /* six steps of an 8-bit converter over 4 V: above an uncalibrated loop's error */
#define APP_SETTLE_US 2000u       /* from setting an output to measuring it in a self-test */

/* Before the protocol's limit, by more than an iteration of the main loop takes. */
#define APP_WATCHDOG_US (BP_WATCHDOG_MS * 1000u - 10000u)

typedef struct {
    bp_decoder decoder;
    bp_arm_state state;
    uint8_t latched;               /* BP_FAULT_WATCHDOG, BP_FAULT_BROWN_OUT */
    bool clamped;
    int32_t set_uv[BP_CHANNELS];   /* what the outputs are set to */
    uint64_t fed_us;               /* when voltages were last applied, or the board was armed */
} app;

/* To be called once, after board_init. */
void app_init(app *self);

/* One iteration of the main loop: the safety checks, and at most one command. */
void app_step(app *self);

#endif
