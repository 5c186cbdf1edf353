/*
 * What the host and the PSoC5 board say to each other; specification: docs/protocol.md.
 *
 * C99, no library calls, no allocation, no global state. Times are microseconds of the board's clock, voltages
 * microvolts, four values are always throttle, pitch, roll, yaw.
 */
#ifndef BENCH_PROTO_H
#define BENCH_PROTO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define BP_VERSION 1u       /* protocol version: the first byte of every frame */
#define BP_DELIMITER 0u     /* ends every frame and occurs nowhere inside one */
#define BP_MAX_WIRE 64u     /* longest frame of any version on the wire, delimiter included, bytes */
#define BP_WATCHDOG_MS 300u /* an armed board zeroes its outputs when it applied no voltages for this long */
#define BP_CHANNELS 4u

typedef enum {
    BP_HELLO = 0x01,
    BP_ARM = 0x02,
    BP_DISARM = 0x03,
    BP_ZERO = 0x04,
    BP_READ = 0x05,
    BP_SET_VOLTAGES = 0x06,
    BP_SELF_TEST = 0x07,
    BP_FIRST_ANSWER = 0x80, /* types from here on are the board's */
    BP_HELLO_ANSWER = 0x81,
    BP_READBACK = 0x82,
    BP_SELF_TEST_REPORT = 0x83,
    BP_ERROR_REPORT = 0x84,
    BP_WRONG_VERSION = 0xFF /* the one layout that is the same in all versions */
} bp_type;

typedef enum { BP_DISARMED = 0, BP_ARMED = 1, BP_TRIPPED = 2 } bp_arm_state;

/* Bits of a readback's faults. */
#define BP_FAULT_WATCHDOG 0x01u
#define BP_FAULT_CLAMPED 0x02u
#define BP_FAULT_MISMATCH 0x04u
#define BP_FAULT_BROWN_OUT 0x08u
#define BP_FAULTS_KNOWN 0x0Fu

/* What an error report says. Codes up to 7 are the decoder's statuses of the same names. */
typedef enum {
    BP_ERROR_OVER_LONG = 1,
    BP_ERROR_STUFFING = 2,
    BP_ERROR_TRUNCATED = 3,
    BP_ERROR_CRC = 4,
    BP_ERROR_UNKNOWN_TYPE = 5,
    BP_ERROR_LENGTH = 6,
    BP_ERROR_VALUE = 7,
    BP_ERROR_NOT_ARMED = 16,
    BP_ERROR_LATE = 17,
    BP_ERROR_TRIPPED = 18,
    BP_ERROR_NOT_READY = 19,
    BP_ERROR_ARMED = 20
} bp_error;

/* What the decoder makes of a byte. */
typedef enum {
    BP_PENDING = 0,                           /* no frame ends here */
    BP_OVER_LONG = BP_ERROR_OVER_LONG,        /* more bytes without a delimiter than any frame has */
    BP_STUFFING = BP_ERROR_STUFFING,          /* the byte stuffing points beyond the end */
    BP_TRUNCATED = BP_ERROR_TRUNCATED,        /* too short for header and checksum */
    BP_CRC = BP_ERROR_CRC,                    /* the checksum does not match */
    BP_UNKNOWN_TYPE = BP_ERROR_UNKNOWN_TYPE,  /* intact, of a type that this side is not to receive */
    BP_LENGTH = BP_ERROR_LENGTH,              /* intact, payload length is not that of the type */
    BP_VALUE = BP_ERROR_VALUE,                /* intact, a field has a value that it cannot have */
    BP_OTHER_VERSION = 8,                     /* intact, of another protocol version */
    BP_FRAME = 9                              /* a frame */
} bp_status;

typedef struct {
    uint32_t gain_ppm; /* voltage read = gain x voltage set + offset */
    int32_t offset_uv;
} bp_calibration;

/* A frame. `version` is BP_VERSION in all that one sends. */
typedef struct {
    uint8_t version;
    uint8_t type;
    uint16_t sequence;
    union {
        struct {
            uint64_t deadline_us;
            int32_t voltages_uv[BP_CHANNELS];
        } set_voltages;
        struct {
            int32_t level_uv;
        } self_test;
        struct {
            uint8_t firmware[3]; /* major, minor, patch */
            bp_calibration calibration[BP_CHANNELS];
        } hello;
        struct {
            uint64_t device_time_us;
            int32_t voltages_uv[BP_CHANNELS];
            uint8_t state;  /* bp_arm_state */
            uint8_t faults; /* BP_FAULT_ bits */
        } readback;
        struct {
            uint64_t device_time_us;
            int32_t deviations_uv[BP_CHANNELS];
            bool passed;
        } self_test_report;
        struct {
            uint64_t device_time_us;
            uint8_t code; /* bp_error */
        } error_report;
        struct {
            uint8_t host_version; /* the board's is the frame's */
        } wrong_version;
    } body;
} bp_frame;

/* Whose frames a decoder accepts: the board listens to the host, the host to the board. */
typedef enum { BP_FROM_HOST, BP_FROM_BOARD } bp_sender;

typedef struct {
    bp_sender sender;
    bool over_long;
    uint8_t length;
    uint8_t stuffed[BP_MAX_WIRE - 1u];
} bp_decoder;

/* Prepares a decoder for the start of a stream. */
void bp_decoder_init(bp_decoder *decoder, bp_sender sender);

/*
 * Takes the next byte of the stream. BP_FRAME: `frame` holds a frame. From BP_UNKNOWN_TYPE to BP_OTHER_VERSION: the
 * frame was intact, and its version, type and sequence are in `frame`; otherwise these are 0.
 */
bp_status bp_decoder_push(bp_decoder *decoder, uint8_t byte, bp_frame *frame);

/* Writes a frame as it goes over the wire, delimiter included; returns its length, or 0 for a type that is none. */
size_t bp_encode(const bp_frame *frame, uint8_t wire[BP_MAX_WIRE]);

/*
 * The board's answer to what its decoder rejected with `status`. False: say nothing (nothing was rejected, or the
 * board hears an echo of itself and must not answer itself for ever).
 */
bool bp_refuse(bp_status status, const bp_frame *rejected, uint64_t device_time_us, bp_frame *answer);

#endif
