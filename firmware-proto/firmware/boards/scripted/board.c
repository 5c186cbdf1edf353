/*
 * A board whose clock, supply and line are told by standard input: the application's tests run on it, in no time and the same
 * each time. Each line is one order; answers and what the board did come out one a line, closed for each order by the time and ".".
 *
 *   run US             lets so many microseconds pass
 *   rx HEX             bytes arrive
 *   supply GOOD        1: the supply is high enough from now on; 0: it is not
 *   open CHANNEL       the wire from this output to its input breaks: the input reads 0
 *   full YES           1: the transmit buffer has no room; 0: it has
 *   reset BROWN_OUT    a reset; 1: the supply caused it
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "loop.h"

#define IDLE_US 100u

static uint64_t now_us, end_us;
static int32_t dac_uv[BP_CHANNELS];
static bool opened[BP_CHANNELS], full, brown_out, supply_good = true;
static uint8_t received[1 << 16];
static size_t received_length, received_read;

void board_init(void) {}
uint64_t board_time_us(void) { return now_us; }
bool board_supply_good(void) { return supply_good; }
bool board_reset_by_brown_out(void) { return brown_out; }
void board_watchdog_start(void) {}
void board_watchdog_feed(void) {}
void board_idle(void) { now_us += IDLE_US; }

void board_dac_set(unsigned channel, int32_t microvolts)
{
    if (dac_uv[channel] != microvolts) {
        dac_uv[channel] = microvolts;
        printf("%" PRIu64 " dac %u %" PRId32 "\n", now_us, channel, microvolts);
    }
    loop_set(channel, microvolts);
}

int32_t board_adc_read(unsigned channel) { return opened[channel] ? 0 : loop_read(channel); }

bp_calibration board_calibration(unsigned channel)
{
    (void)channel;
    return (bp_calibration){.gain_ppm = 1000000, .offset_uv = 0};
}

int board_serial_read(void) { return received_read < received_length ? received[received_read++] : -1; }

bool board_serial_write(const uint8_t *bytes, size_t length)
{
    if (full) {
        return false;
    }
    printf("%" PRIu64 " tx ", now_us);
    for (size_t i = 0; i < length; i++) {
        printf("%02x", bytes[i]);
    }
    printf("\n");
    return true;
}

void board_signal(board_event event)
{
    static const char *const NAMES[] = {"applied", "armed", "disarmed", "tripped"};
    printf("%" PRIu64 " %s\n", now_us, NAMES[event]);
}

static void receive(const char *hex)
{
    received_length = received_read = 0;
    for (unsigned byte; received_length < sizeof received && sscanf(hex, "%2x", &byte) == 1; hex += 2) {
        received[received_length++] = (uint8_t)byte;
    }
}

int main(void)
{
    static char line[1 << 17];
    static app self;
    app_init(&self);
    while (fgets(line, sizeof line, stdin) != NULL) {
        char *argument = strchr(line, ' ');
        if (argument == NULL) {
            fprintf(stderr, "an order needs an argument: %s", line);
            return 2;
        }
        *argument++ = '\0';
        const long long number = atoll(argument);
        end_us = now_us;
        if (strcmp(line, "run") == 0) {
            end_us += (uint64_t)number;
        } else if (strcmp(line, "rx") == 0) {
            receive(argument);
        } else if (strcmp(line, "supply") == 0) {
            supply_good = number != 0;
        } else if (strcmp(line, "open") == 0) {
            opened[(size_t)number % BP_CHANNELS] = true;
        } else if (strcmp(line, "full") == 0) {
            full = number != 0;
        } else if (strcmp(line, "reset") == 0) {
            brown_out = number != 0;
            now_us = end_us = 0;
            app_init(&self);
        } else {
            fprintf(stderr, "no such order: %s\n", line);
            return 2;
        }
        do {
            app_step(&self);
            if (now_us < end_us) {
                now_us += IDLE_US;
            }
        } while (now_us < end_us || received_read < received_length);
        printf("%" PRIu64 " .\n", now_us);
        fflush(stdout);
    }
    return 0;
}
