/*
 * Holds bench_proto.c against the golden vectors, and lets the Rust tests drive it.
 *
 *   bench_proto_test golden FILE...       every record must be parsed, and produced, as it stands (golden/README.md)
 *   bench_proto_test decode host|board    a stream on stdin to records on stdout, each frame with its re-encoding
 */
#include "bench_proto.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Text that grows and is compared or printed. */

static char text[8192];
static size_t text_length;

static void text_clear(void)
{
    text_length = 0;
    text[0] = '\0';
}

static void say(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    const int length = vsnprintf(text + text_length, sizeof text - text_length, format, arguments);
    va_end(arguments);
    if (length < 0 || (size_t)length >= sizeof text - text_length) {
        fputs("bench_proto_test: a record is longer than the buffer\n", stderr);
        exit(2);
    }
    text_length += (size_t)length;
}

/* Frames as text. */

static const char *type_name(uint8_t type)
{
    switch (type) {
    case BP_HELLO:
    case BP_HELLO_ANSWER:
        return "hello";
    case BP_ARM:
        return "arm";
    case BP_DISARM:
        return "disarm";
    case BP_ZERO:
        return "zero";
    case BP_READ:
        return "read";
    case BP_SET_VOLTAGES:
        return "set_voltages";
    case BP_SELF_TEST:
        return "self_test";
    case BP_READBACK:
        return "readback";
    case BP_SELF_TEST_REPORT:
        return "self_test_report";
    case BP_ERROR_REPORT:
        return "error_report";
    case BP_WRONG_VERSION:
        return "wrong_version";
    default:
        return "?";
    }
}

static const char *error_name(uint8_t code)
{
    switch (code) {
    case BP_ERROR_OVER_LONG:
        return "over_long";
    case BP_ERROR_STUFFING:
        return "stuffing";
    case BP_ERROR_TRUNCATED:
        return "truncated";
    case BP_ERROR_CRC:
        return "crc";
    case BP_ERROR_UNKNOWN_TYPE:
        return "unknown_type";
    case BP_ERROR_LENGTH:
        return "length";
    case BP_ERROR_VALUE:
        return "value";
    case BP_ERROR_NOT_ARMED:
        return "not_armed";
    case BP_ERROR_LATE:
        return "late";
    case BP_ERROR_TRIPPED:
        return "tripped";
    case BP_ERROR_NOT_READY:
        return "not_ready";
    case BP_ERROR_ARMED:
        return "armed";
    default:
        return "?";
    }
}

static const char *state_name(uint8_t state)
{
    static const char *const names[] = {"disarmed", "armed", "tripped"};
    return state <= BP_TRIPPED ? names[state] : "?";
}

static void say_faults(uint8_t faults)
{
    static const char *const names[] = {"watchdog", "clamped", "mismatch", "brown_out"};
    const unsigned bits = faults;
    const char *separator = "";
    say(" faults=%s", bits == 0 ? "none" : "");
    for (unsigned i = 0; i < 4; i++) {
        if ((bits >> i & 1u) != 0) {
            say("%s%s", separator, names[i]);
            separator = "+";
        }
    }
}

static void say_four(const char *key, const int32_t v[BP_CHANNELS])
{
    say(" %s=%" PRId32 ",%" PRId32 ",%" PRId32 ",%" PRId32, key, v[0], v[1], v[2], v[3]);
}

static void say_frame(const bp_frame *frame)
{
    say("%s sequence=%u", type_name(frame->type), (unsigned)frame->sequence);
    switch (frame->type) {
    case BP_SET_VOLTAGES:
        say(" deadline_us=%" PRIu64, frame->body.set_voltages.deadline_us);
        say_four("voltages_uv", frame->body.set_voltages.voltages_uv);
        break;
    case BP_SELF_TEST:
        say(" level_uv=%" PRId32, frame->body.self_test.level_uv);
        break;
    case BP_HELLO_ANSWER:
        say(" firmware=%u.%u.%u", (unsigned)frame->body.hello.firmware[0],
            (unsigned)frame->body.hello.firmware[1], (unsigned)frame->body.hello.firmware[2]);
        for (size_t i = 0; i < BP_CHANNELS; i++) {
            const bp_calibration *channel = &frame->body.hello.calibration[i];
            say("%s%" PRIu32 ":%" PRId32, i == 0 ? " calibration=" : ",", channel->gain_ppm, channel->offset_uv);
        }
        break;
    case BP_READBACK:
        say(" device_time_us=%" PRIu64, frame->body.readback.device_time_us);
        say_four("voltages_uv", frame->body.readback.voltages_uv);
        say(" state=%s", state_name(frame->body.readback.state));
        say_faults(frame->body.readback.faults);
        break;
    case BP_SELF_TEST_REPORT:
        say(" device_time_us=%" PRIu64, frame->body.self_test_report.device_time_us);
        say_four("deviations_uv", frame->body.self_test_report.deviations_uv);
        say(" passed=%s", frame->body.self_test_report.passed ? "yes" : "no");
        break;
    case BP_ERROR_REPORT:
        say(" device_time_us=%" PRIu64 " code=%s", frame->body.error_report.device_time_us,
            error_name(frame->body.error_report.code));
        break;
    case BP_WRONG_VERSION:
        say(" board_version=%u host_version=%u", (unsigned)frame->version,
            (unsigned)frame->body.wrong_version.host_version);
        break;
    default:
        break;
    }
    say("\n");
}

/* Streams as text. */

static const char *sender_name(bp_sender sender)
{
    return sender == BP_FROM_HOST ? "host" : "board";
}

static void say_rejected(bp_sender sender, bp_status status, const bp_frame *frame)
{
    bp_frame answer;
    if (status == BP_OTHER_VERSION) {
        say("%s rejected version sequence=%u received=%u\n", sender_name(sender), (unsigned)frame->sequence,
            (unsigned)frame->version);
    } else if (status >= BP_UNKNOWN_TYPE) {
        say("%s rejected %s sequence=%u\n", sender_name(sender), error_name((uint8_t)status),
            (unsigned)frame->sequence);
    } else {
        say("%s rejected %s\n", sender_name(sender), error_name((uint8_t)status));
    }
    /* The clock of the board in these tests stands at one second. */
    if (sender == BP_FROM_HOST && bp_refuse(status, frame, 1000000, &answer)) {
        say("answer ");
        say_frame(&answer);
    }
}

static void say_status(bp_sender sender, bp_status status, const bp_frame *frame)
{
    if (status == BP_FRAME) {
        say("%s ", sender_name(sender));
        say_frame(frame);
    } else if (status != BP_PENDING) {
        say_rejected(sender, status, frame);
    }
}

static int decode(bp_sender sender)
{
    bp_decoder decoder;
    bp_frame frame;
    uint8_t wire[BP_MAX_WIRE];
    int byte;
    bp_decoder_init(&decoder, sender);
    while ((byte = getchar()) != EOF) {
        const bp_status status = bp_decoder_push(&decoder, (uint8_t)byte, &frame);
        if (status == BP_PENDING) {
            continue;
        }
        text_clear();
        say_status(sender, status, &frame);
        if (status == BP_FRAME) {
            const size_t length = bp_encode(&frame, wire);
            for (size_t i = 0; i < length; i++) {
                say("%s%02X", i == 0 ? "  " : " ", wire[i]);
            }
            say("\n");
        }
        fputs(text, stdout);
    }
    return 0;
}

/* Golden files. */

static size_t parse_hex(const char *line, uint8_t *bytes, size_t room)
{
    size_t length = 0;
    char *end;
    for (;; line = end) {
        const unsigned long byte = strtoul(line, &end, 16);
        if (end == line || byte > UINT8_MAX || length == room) {
            return length;
        }
        bytes[length++] = (uint8_t)byte;
    }
}

/* Whether `stream` reads as `expected`, and, where it is one frame and nothing else, is produced from what was read. */
static bool check(const char *expected, const uint8_t *stream, size_t length)
{
    const bp_sender sender = strncmp(expected, "host", 4) == 0 ? BP_FROM_HOST : BP_FROM_BOARD;
    bp_decoder decoder;
    bp_frame frame;
    bp_status status = BP_PENDING;
    uint8_t wire[BP_MAX_WIRE];
    bp_decoder_init(&decoder, sender);
    text_clear();
    for (size_t i = 0; i < length; i++) {
        status = bp_decoder_push(&decoder, stream[i], &frame);
        say_status(sender, status, &frame);
    }
    if (strcmp(text, expected) != 0) {
        return false;
    }
    const bool one_frame = status == BP_FRAME && strchr(expected, '\n') == expected + strlen(expected) - 1;
    return !one_frame || (bp_encode(&frame, wire) == length && memcmp(wire, stream, length) == 0);
}

static int check_file(const char *path)
{
    static char line[1024];
    static char expected[4096];
    static uint8_t stream[256];
    unsigned number = 0, records = 0, failed = 0;
    FILE *file = fopen(path, "r");
    if (file == NULL) {
        fprintf(stderr, "%s: cannot be read\n", path);
        return 1;
    }
    expected[0] = '\0';
    while (fgets(line, sizeof line, file) != NULL) {
        number++;
        if (line[0] == '#' || line[0] == '\n') {
            continue;
        }
        if (line[0] != ' ') {
            strncat(expected, line, sizeof expected - strlen(expected) - 1);
            continue;
        }
        records++;
        if (!check(expected, stream, parse_hex(line, stream, sizeof stream))) {
            fprintf(stderr, "%s:%u: expected\n%sfound\n%s", path, number, expected, text);
            failed++;
        }
        expected[0] = '\0';
    }
    fclose(file);
    printf("%s: %u records, %u failed\n", path, records, failed);
    return records == 0 || failed > 0;
}

int main(int argc, char **argv)
{
    if (argc == 3 && strcmp(argv[1], "decode") == 0) {
        return decode(strcmp(argv[2], "host") == 0 ? BP_FROM_HOST : BP_FROM_BOARD);
    }
    if (argc > 2 && strcmp(argv[1], "golden") == 0) {
        int failed = 0;
        for (int i = 2; i < argc; i++) {
            failed |= check_file(argv[i]);
        }
        return failed;
    }
    fputs("usage: bench_proto_test golden FILE... | decode host|board\n", stderr);
    return 2;
}
