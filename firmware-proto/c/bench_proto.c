#include "bench_proto.h"

#define HEADER_LEN 4u /* version, type, sequence number */
#define CRC_LEN 4u
#define MAX_CONTENT (BP_MAX_WIRE - 2u) /* less one byte of stuffing and the delimiter */
#define NO_SUCH_TYPE SIZE_MAX

/* Integers, little-endian. */

static void put(uint8_t **at, uint64_t value, unsigned bytes)
{
    for (; bytes > 0; bytes--) {
        *(*at)++ = (uint8_t)value;
        value >>= 8;
    }
}

static uint64_t take(const uint8_t **at, unsigned bytes)
{
    uint64_t value = 0;
    for (unsigned i = 0; i < bytes; i++) {
        value |= (uint64_t)*(*at)++ << (8 * i);
    }
    return value;
}

static void put_i32s(uint8_t **at, const int32_t *values, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        put(at, (uint32_t)values[i], 4);
    }
}

static int32_t take_i32(const uint8_t **at)
{
    const uint32_t bits = (uint32_t)take(at, 4);
    /* A plain cast of what is above INT32_MAX would be implementation-defined. */
    return bits <= INT32_MAX ? (int32_t)bits : -(int32_t)(UINT32_MAX - bits) - 1;
}

static void take_i32s(const uint8_t **at, int32_t *values, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        values[i] = take_i32(at);
    }
}

/* Checksum and stuffing. */

/* CRC-32/ISO-HDLC, the one of zlib and Ethernet. */
static uint32_t crc32(const uint8_t *bytes, size_t length)
{
    uint32_t crc = UINT32_MAX;
    for (size_t i = 0; i < length; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ ((crc & 1u) != 0 ? 0xEDB88320u : 0u);
        }
    }
    return ~crc;
}

/* COBS for content shorter than 254 bytes, with the delimiter. */
static size_t stuff(const uint8_t *content, size_t length, uint8_t *wire)
{
    size_t code_at = 0;
    for (size_t i = 0; i < length; i++) {
        wire[i + 1] = content[i];
        if (content[i] == 0) {
            wire[code_at] = (uint8_t)(i + 1 - code_at);
            code_at = i + 1;
        }
    }
    wire[code_at] = (uint8_t)(length + 1 - code_at);
    wire[length + 1] = BP_DELIMITER;
    return length + 2;
}

/* The inverse, without the delimiter. False when a code points beyond the end. */
static bool unstuff(const uint8_t *stuffed, size_t length, uint8_t *content)
{
    size_t code_at = 0;
    while (code_at < length) {
        const size_t next = code_at + stuffed[code_at];
        if (next > length) {
            return false;
        }
        for (size_t i = code_at + 1; i < next; i++) {
            content[i - 1] = stuffed[i];
        }
        if (next < length) {
            content[next - 1] = 0;
        }
        code_at = next;
    }
    return true;
}

/* Payloads. */

static size_t payload_len(uint8_t type)
{
    switch (type) {
    case BP_HELLO:
    case BP_ARM:
    case BP_DISARM:
    case BP_ZERO:
    case BP_READ:
        return 0;
    case BP_SET_VOLTAGES:
        return 24;
    case BP_SELF_TEST:
        return 4;
    case BP_HELLO_ANSWER:
        return 35;
    case BP_READBACK:
        return 26;
    case BP_SELF_TEST_REPORT:
        return 25;
    case BP_ERROR_REPORT:
        return 9;
    case BP_WRONG_VERSION:
        return 1;
    default:
        return NO_SUCH_TYPE;
    }
}

static void put_payload(uint8_t **at, const bp_frame *frame)
{
    switch (frame->type) {
    case BP_SET_VOLTAGES:
        put(at, frame->body.set_voltages.deadline_us, 8);
        put_i32s(at, frame->body.set_voltages.voltages_uv, BP_CHANNELS);
        break;
    case BP_SELF_TEST:
        put_i32s(at, &frame->body.self_test.level_uv, 1);
        break;
    case BP_HELLO_ANSWER:
        for (size_t i = 0; i < 3; i++) {
            put(at, frame->body.hello.firmware[i], 1);
        }
        for (size_t i = 0; i < BP_CHANNELS; i++) {
            put(at, frame->body.hello.calibration[i].gain_ppm, 4);
            put_i32s(at, &frame->body.hello.calibration[i].offset_uv, 1);
        }
        break;
    case BP_READBACK:
        put(at, frame->body.readback.device_time_us, 8);
        put_i32s(at, frame->body.readback.voltages_uv, BP_CHANNELS);
        put(at, frame->body.readback.state, 1);
        put(at, frame->body.readback.faults, 1);
        break;
    case BP_SELF_TEST_REPORT:
        put(at, frame->body.self_test_report.device_time_us, 8);
        put_i32s(at, frame->body.self_test_report.deviations_uv, BP_CHANNELS);
        put(at, frame->body.self_test_report.passed ? 1 : 0, 1);
        break;
    case BP_ERROR_REPORT:
        put(at, frame->body.error_report.device_time_us, 8);
        put(at, frame->body.error_report.code, 1);
        break;
    case BP_WRONG_VERSION:
        put(at, frame->body.wrong_version.host_version, 1);
        break;
    default: /* the others have none */
        break;
    }
}

static bool is_error(uint8_t code)
{
    return (code >= BP_ERROR_OVER_LONG && code <= BP_ERROR_VALUE)
        || (code >= BP_ERROR_NOT_ARMED && code <= BP_ERROR_ARMED);
}

/* False when a field has a value that it cannot have. */
static bool take_payload(const uint8_t **at, bp_frame *frame)
{
    uint8_t passed;
    switch (frame->type) {
    case BP_SET_VOLTAGES:
        frame->body.set_voltages.deadline_us = take(at, 8);
        take_i32s(at, frame->body.set_voltages.voltages_uv, BP_CHANNELS);
        return true;
    case BP_SELF_TEST:
        frame->body.self_test.level_uv = take_i32(at);
        return true;
    case BP_HELLO_ANSWER:
        for (size_t i = 0; i < 3; i++) {
            frame->body.hello.firmware[i] = (uint8_t)take(at, 1);
        }
        for (size_t i = 0; i < BP_CHANNELS; i++) {
            frame->body.hello.calibration[i].gain_ppm = (uint32_t)take(at, 4);
            frame->body.hello.calibration[i].offset_uv = take_i32(at);
        }
        return true;
    case BP_READBACK:
        frame->body.readback.device_time_us = take(at, 8);
        take_i32s(at, frame->body.readback.voltages_uv, BP_CHANNELS);
        frame->body.readback.state = (uint8_t)take(at, 1);
        frame->body.readback.faults = (uint8_t)take(at, 1);
        return frame->body.readback.state <= BP_TRIPPED && frame->body.readback.faults <= BP_FAULTS_KNOWN;
    case BP_SELF_TEST_REPORT:
        frame->body.self_test_report.device_time_us = take(at, 8);
        take_i32s(at, frame->body.self_test_report.deviations_uv, BP_CHANNELS);
        passed = (uint8_t)take(at, 1);
        frame->body.self_test_report.passed = passed == 1;
        return passed <= 1;
    case BP_ERROR_REPORT:
        frame->body.error_report.device_time_us = take(at, 8);
        frame->body.error_report.code = (uint8_t)take(at, 1);
        return is_error(frame->body.error_report.code);
    case BP_WRONG_VERSION:
        frame->body.wrong_version.host_version = (uint8_t)take(at, 1);
        return true;
    default: /* the others have none */
        return true;
    }
}

/* Frames. */

size_t bp_encode(const bp_frame *frame, uint8_t wire[BP_MAX_WIRE])
{
    uint8_t content[MAX_CONTENT];
    uint8_t *at = content;
    if (payload_len(frame->type) == NO_SUCH_TYPE) {
        return 0;
    }
    put(&at, frame->version, 1);
    put(&at, frame->type, 1);
    put(&at, frame->sequence, 2);
    put_payload(&at, frame);
    put(&at, crc32(content, (size_t)(at - content)), CRC_LEN);
    return stuff(content, (size_t)(at - content), wire);
}

static bool is_for(bp_sender sender, uint8_t type)
{
    return payload_len(type) != NO_SUCH_TYPE && (type >= BP_FIRST_ANSWER) == (sender == BP_FROM_BOARD);
}

/* Reads the bytes before a delimiter; `length` is not 0. */
static bp_status parse(bp_sender sender, const uint8_t *stuffed, size_t length, bp_frame *frame)
{
    uint8_t content[MAX_CONTENT];
    const uint8_t *at = content;
    if (!unstuff(stuffed, length, content)) {
        return BP_STUFFING;
    }
    if (length - 1 < HEADER_LEN + CRC_LEN) {
        return BP_TRUNCATED;
    }
    const size_t checked = length - 1 - CRC_LEN;
    const uint8_t *received = content + checked;
    if (crc32(content, checked) != take(&received, CRC_LEN)) {
        return BP_CRC;
    }
    frame->version = (uint8_t)take(&at, 1);
    frame->type = (uint8_t)take(&at, 1);
    frame->sequence = (uint16_t)take(&at, 2);
    const bool in_every_version = sender == BP_FROM_BOARD && frame->type == BP_WRONG_VERSION;
    if (frame->version != BP_VERSION && !in_every_version) {
        return BP_OTHER_VERSION;
    }
    if (!is_for(sender, frame->type)) {
        return BP_UNKNOWN_TYPE;
    }
    if (checked - HEADER_LEN != payload_len(frame->type)) {
        return BP_LENGTH;
    }
    return take_payload(&at, frame) ? BP_FRAME : BP_VALUE;
}

void bp_decoder_init(bp_decoder *decoder, bp_sender sender)
{
    decoder->sender = sender;
    decoder->length = 0;
    decoder->over_long = false;
}

bp_status bp_decoder_push(bp_decoder *decoder, uint8_t byte, bp_frame *frame)
{
    const size_t length = decoder->length;
    const bool over_long = decoder->over_long;
    frame->version = 0;
    frame->type = 0;
    frame->sequence = 0;
    if (byte != BP_DELIMITER) {
        if (length < sizeof decoder->stuffed) {
            decoder->stuffed[length] = byte;
            decoder->length++;
        } else {
            decoder->over_long = true;
        }
        return BP_PENDING;
    }
    bp_decoder_init(decoder, decoder->sender);
    if (over_long) {
        return BP_OVER_LONG;
    }
    return length == 0 ? BP_PENDING : parse(decoder->sender, decoder->stuffed, length, frame);
}

bool bp_refuse(bp_status status, const bp_frame *rejected, uint64_t device_time_us, bp_frame *answer)
{
    const bool is_echo = status == BP_UNKNOWN_TYPE && rejected->type >= BP_FIRST_ANSWER;
    if (status == BP_PENDING || status == BP_FRAME || is_echo) {
        return false;
    }
    answer->version = BP_VERSION;
    answer->sequence = rejected->sequence;
    if (status == BP_OTHER_VERSION) {
        answer->type = BP_WRONG_VERSION;
        answer->body.wrong_version.host_version = rejected->version;
    } else {
        answer->type = BP_ERROR_REPORT;
        answer->body.error_report.device_time_us = device_time_us;
        answer->body.error_report.code = (uint8_t)status;
    }
    return true;
}
