#include "app.h"

static const uint8_t VERSION[3] = {1, 0, 0};

/* Outputs. */

static void set_output(app *self, unsigned channel, int32_t microvolts)
{
    self->set_uv[channel] = microvolts;
    board_dac_set(channel, microvolts);
}

static void zero(app *self)
{
    for (unsigned i = 0; i < BP_CHANNELS; i++) {
        set_output(self, i, 0);
    }
    self->clamped = false;
}

static void leave_armed(app *self, bp_arm_state state, board_event event)
{
    zero(self);
    self->state = state;
    board_signal(event);
}

static void trip(app *self, uint8_t fault)
{
    self->latched |= fault;
    if (self->state == BP_ARMED) {
        leave_armed(self, BP_TRIPPED, BOARD_TRIPPED);
    }
}

/* What must hold whatever the host does. */
static void guard(app *self)
{
    board_watchdog_feed();
    if (!board_supply_good()) {
        trip(self, BP_FAULT_BROWN_OUT);
    }
    if (self->state == BP_ARMED && board_time_us() - self->fed_us >= APP_WATCHDOG_US) {
        trip(self, BP_FAULT_WATCHDOG);
    }
}

/* Brings the outputs to their targets at the slew rate; the guard may end it. */
static void slew(app *self, const int32_t *target_uv)
{
    uint64_t last_us = board_time_us();
    bool there = false;
    while (!there && self->state == BP_ARMED) {
        const uint64_t now_us = board_time_us();
        const uint64_t elapsed_us = now_us - last_us;
        const int32_t most_uv = elapsed_us * APP_SLEW_UV_PER_US < APP_RANGE_UV
            ? (int32_t)(elapsed_us * APP_SLEW_UV_PER_US)
            : APP_RANGE_UV;
        there = true;
        for (unsigned i = 0; i < BP_CHANNELS; i++) {
            int32_t change_uv = target_uv[i] - self->set_uv[i];
            if (change_uv > most_uv) {
                change_uv = most_uv;
                there = false;
            } else if (change_uv < -most_uv) {
                change_uv = -most_uv;
                there = false;
            }
            if (change_uv != 0) {
                set_output(self, i, self->set_uv[i] + change_uv);
            }
        }
        last_us = now_us;
        if (!there) {
            board_idle();
            guard(self);
        }
    }
}

/* Inputs. */

/* Measured less expected. */
static int32_t deviation_uv(const app *self, unsigned channel, int32_t measured_uv)
{
    const bp_calibration loop = board_calibration(channel);
    const int64_t expected_uv = (int64_t)self->set_uv[channel] * loop.gain_ppm / 1000000 + loop.offset_uv;
    return (int32_t)(measured_uv - expected_uv);
}

static bool deviates(int32_t deviation)
{
    return deviation > APP_MISMATCH_UV || deviation < -APP_MISMATCH_UV;
}

static void measure(const app *self, bp_frame *answer)
{
    answer->type = BP_READBACK;
    answer->body.readback.device_time_us = board_time_us();
    answer->body.readback.state = (uint8_t)self->state;
    answer->body.readback.faults = self->latched | (self->clamped ? BP_FAULT_CLAMPED : 0u);
    for (unsigned i = 0; i < BP_CHANNELS; i++) {
        const int32_t measured_uv = board_adc_read(i);
        answer->body.readback.voltages_uv[i] = measured_uv;
        if (deviates(deviation_uv(self, i, measured_uv))) {
            answer->body.readback.faults |= BP_FAULT_MISMATCH;
        }
    }
}

/* Commands. Each fills the answer; its version and sequence number are there already. */

static void refuse(bp_frame *answer, bp_error code)
{
    answer->type = BP_ERROR_REPORT;
    answer->body.error_report.device_time_us = board_time_us();
    answer->body.error_report.code = (uint8_t)code;
}

static void arm(app *self, bp_frame *answer)
{
    if (self->state == BP_TRIPPED) {
        refuse(answer, BP_ERROR_TRIPPED);
        return;
    }
    measure(self, answer);
    if (self->state == BP_ARMED) {
        return;
    }
    if (answer->body.readback.faults != 0) {
        refuse(answer, BP_ERROR_NOT_READY);
        return;
    }
    self->state = BP_ARMED;
    self->fed_us = board_time_us();
    answer->body.readback.state = BP_ARMED;
    board_signal(BOARD_ARMED);
}

static void set_voltages(app *self, const bp_frame *command, bp_frame *answer)
{
    if (self->state != BP_ARMED) {
        refuse(answer, self->state == BP_TRIPPED ? BP_ERROR_TRIPPED : BP_ERROR_NOT_ARMED);
        return;
    }
    if (board_time_us() > command->body.set_voltages.deadline_us) {
        refuse(answer, BP_ERROR_LATE);
        return;
    }
    self->fed_us = board_time_us();
    self->clamped = false;
    int32_t target_uv[BP_CHANNELS];
    for (unsigned i = 0; i < BP_CHANNELS; i++) {
        target_uv[i] = command->body.set_voltages.voltages_uv[i];
        if (target_uv[i] < 0) {
            target_uv[i] = 0;
            self->clamped = true;
        } else if (target_uv[i] > APP_RANGE_UV) {
            target_uv[i] = APP_RANGE_UV;
            self->clamped = true;
        }
    }
    board_signal(BOARD_APPLIED);
    slew(self, target_uv);
    measure(self, answer);
}

static void self_test(app *self, const bp_frame *command, bp_frame *answer)
{
    if (self->state != BP_DISARMED) {
        refuse(answer, self->state == BP_TRIPPED ? BP_ERROR_TRIPPED : BP_ERROR_ARMED);
        return;
    }
    int32_t level_uv = command->body.self_test.level_uv;
    level_uv = level_uv < 0 ? 0 : level_uv > APP_RANGE_UV ? APP_RANGE_UV : level_uv;
    answer->type = BP_SELF_TEST_REPORT;
    answer->body.self_test_report.passed = true;
    for (unsigned i = 0; i < BP_CHANNELS; i++) {
        set_output(self, i, level_uv);
        const uint64_t set_us = board_time_us();
        while (board_time_us() - set_us < APP_SETTLE_US) {
            guard(self);
            board_idle();
        }
        const int32_t deviation = deviation_uv(self, i, board_adc_read(i));
        set_output(self, i, 0);
        answer->body.self_test_report.deviations_uv[i] = deviation;
        if (deviates(deviation)) {
            answer->body.self_test_report.passed = false;
        }
    }
    if ((self->latched & BP_FAULT_BROWN_OUT) != 0) {
        answer->body.self_test_report.passed = false;
    }
    answer->body.self_test_report.device_time_us = board_time_us();
}

static void carry_out(app *self, const bp_frame *command, bp_frame *answer)
{
    answer->version = BP_VERSION;
    answer->sequence = command->sequence;
    switch (command->type) {
    case BP_HELLO:
        answer->type = BP_HELLO_ANSWER;
        for (unsigned i = 0; i < 3; i++) {
            answer->body.hello.firmware[i] = VERSION[i];
        }
        for (unsigned i = 0; i < BP_CHANNELS; i++) {
            answer->body.hello.calibration[i] = board_calibration(i);
        }
        break;
    case BP_ARM:
        arm(self, answer);
        break;
    case BP_DISARM:
        self->latched = 0;
        leave_armed(self, BP_DISARMED, BOARD_DISARMED);
        measure(self, answer);
        break;
    case BP_ZERO:
        zero(self);
        measure(self, answer);
        break;
    case BP_SET_VOLTAGES:
        set_voltages(self, command, answer);
        break;
    case BP_SELF_TEST:
        self_test(self, command, answer);
        break;
    default: /* BP_READ: the decoder lets nothing else through */
        measure(self, answer);
        break;
    }
}

static void answer_with(const bp_frame *answer)
{
    uint8_t wire[BP_MAX_WIRE];
    const size_t length = bp_encode(answer, wire);
    /* What does not fit is dropped: the host takes it for lost and goes on. */
    (void)board_serial_write(wire, length);
}

void app_init(app *self)
{
    bp_decoder_init(&self->decoder, BP_FROM_HOST);
    self->state = BP_DISARMED;
    self->latched = board_reset_by_brown_out() ? BP_FAULT_BROWN_OUT : 0;
    self->fed_us = 0;
    zero(self);
}

void app_step(app *self)
{
    guard(self);
    bp_status status = BP_PENDING;
    bp_frame command;
    for (int byte; status == BP_PENDING && (byte = board_serial_read()) >= 0;) {
        status = bp_decoder_push(&self->decoder, (uint8_t)byte, &command);
    }
    bp_frame answer;
    answer.version = BP_VERSION;
    if (status == BP_FRAME) {
        carry_out(self, &command, &answer);
        answer_with(&answer);
    } else if (bp_refuse(status, &command, board_time_us(), &answer)) {
        answer_with(&answer);
    }
}
