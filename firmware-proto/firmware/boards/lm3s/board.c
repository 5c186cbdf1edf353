/*
 * A Stellaris LM3S6965 as `qemu-system-arm -M lm3s6965evb` has it: a Cortex-M3 as the PSoC5LP is, without its converters and
 * USB. UART0 is the line to the host; UART1 tells what the outputs did, and when. Registers: LM3S6965 data sheet.
 *
 * No interrupt is ever taken: with PRIMASK set, a pending one ends WFI and that is all it is for.
 */
#include "board.h"
#include "loop.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))

#define SYSCTL_RESC REGISTER(0x400FE05Cu)
#define SYSCTL_RCC REGISTER(0x400FE060u)
#define SYSCTL_RCGC0 REGISTER(0x400FE100u)
#define SYSCTL_RCGC1 REGISTER(0x400FE104u)
#define RESC_BROWN_OUT (1u << 2)
/* PLL, 8 MHz crystal, 200 MHz / 16 = 12.5 MHz. */
#define RCC_12_5_MHZ 0x07C00380u
#define TICKS_PER_2_US 25u

#define UART0 0x4000C000u
#define UART1 0x4000D000u
#define UART_DR(base) REGISTER((base) + 0x000u)
#define UART_FR(base) REGISTER((base) + 0x018u)
#define UART_IBRD(base) REGISTER((base) + 0x024u)
#define UART_FBRD(base) REGISTER((base) + 0x028u)
#define UART_LCRH(base) REGISTER((base) + 0x02Cu)
#define UART_CTL(base) REGISTER((base) + 0x030u)
#define UART_IM(base) REGISTER((base) + 0x038u)
#define UART_ICR(base) REGISTER((base) + 0x044u)
#define FR_RX_EMPTY (1u << 4)
#define FR_TX_FULL (1u << 5)
#define RX_INTERRUPTS (1u << 4 | 1u << 6) /* data, time-out */

#define TIMER0_CFG REGISTER(0x40030000u)
#define TIMER0_TAMR REGISTER(0x40030004u)
#define TIMER0_CTL REGISTER(0x4003000Cu)
#define TIMER0_IMR REGISTER(0x40030018u)
#define TIMER0_ICR REGISTER(0x40030024u)
#define TIMER0_TAILR REGISTER(0x40030028u)

#define WATCHDOG_LOAD REGISTER(0x40000000u)
#define WATCHDOG_CTL REGISTER(0x40000008u)
#define WATCHDOG_LOCK REGISTER(0x40000C00u)
/* The first time-out only counts, the second resets: 150 ms each. */
#define WATCHDOG_TICKS (150u * 12500u)

#define SYSTICK_CTRL REGISTER(0xE000E010u)
#define SYSTICK_LOAD REGISTER(0xE000E014u)
#define SYSTICK_NOW REGISTER(0xE000E018u)
#define SYSTICK_MASK 0x00FFFFFFu
#define NVIC_ENABLE REGISTER(0xE000E100u)
#define NVIC_UNPEND REGISTER(0xE000E280u)
#define IRQ_UART0 (1u << 5)
#define IRQ_TIMER0A (1u << 19)

static uint32_t last_tick;
static uint64_t ticks;
static int32_t dac_uv[BP_CHANNELS];

static void start_uart(uint32_t base)
{
    UART_CTL(base) = 0;
    /* 12.5 MHz / (16 x 115,200) = 6 + 50/64. */
    UART_IBRD(base) = 6;
    UART_FBRD(base) = 50;
    UART_LCRH(base) = 0x70; /* 8 bits, no parity, 1 stop bit, FIFOs on */
    UART_CTL(base) = 0x301; /* on, transmit, receive */
}

/* The trace: a number, a word, a number. */

static void trace_text(const char *text)
{
    for (; *text != '\0'; text++) {
        while ((UART_FR(UART1) & FR_TX_FULL) != 0) {
        }
        UART_DR(UART1) = (uint8_t)*text;
    }
}

static void trace_number(uint64_t number)
{
    char digits[21];
    char *at = digits + sizeof digits - 1;
    *at = '\0';
    do {
        *--at = (char)('0' + number % 10);
        number /= 10;
    } while (number > 0);
    trace_text(at);
}

/* The board. */

void board_init(void)
{
    __asm volatile("cpsid i");
    SYSCTL_RCC = RCC_12_5_MHZ;
    SYSCTL_RCGC0 |= 1u << 3;                    /* watchdog */
    SYSCTL_RCGC1 |= 1u << 0 | 1u << 1 | 1u << 16; /* UART0, UART1, TIMER0 */
    start_uart(UART0);
    start_uart(UART1);
    UART_IM(UART0) = RX_INTERRUPTS;
    SYSTICK_LOAD = SYSTICK_MASK;
    SYSTICK_NOW = 0;
    SYSTICK_CTRL = 5; /* on, by the processor's clock, no interrupt */
    TIMER0_CTL = 0;
    TIMER0_CFG = 0;   /* 32 bits */
    TIMER0_TAMR = 2;  /* periodic */
    TIMER0_TAILR = 12500 - 1;
    TIMER0_IMR = 1;
    TIMER0_CTL = 1;
    NVIC_ENABLE = IRQ_UART0 | IRQ_TIMER0A;
    last_tick = SYSTICK_NOW;
    trace_text("0 reset\n");
}

uint64_t board_time_us(void)
{
    /* Counts down, and around once in 1.34 s. */
    const uint32_t tick = SYSTICK_NOW;
    ticks += (last_tick - tick) & SYSTICK_MASK;
    last_tick = tick;
    return ticks * 2 / TICKS_PER_2_US;
}

void board_dac_set(unsigned channel, int32_t microvolts)
{
    if (dac_uv[channel] != microvolts) {
        dac_uv[channel] = microvolts;
        trace_number(board_time_us());
        trace_text(" dac ");
        trace_number(channel);
        trace_text(" ");
        trace_number((uint64_t)microvolts);
        trace_text("\n");
    }
    loop_set(channel, microvolts);
}

int32_t board_adc_read(unsigned channel) { return loop_read(channel); }
bool board_supply_good(void) { return true; }
bool board_reset_by_brown_out(void) { return (SYSCTL_RESC & RESC_BROWN_OUT) != 0; }

bp_calibration board_calibration(unsigned channel)
{
    (void)channel;
    return (bp_calibration){.gain_ppm = 1000000, .offset_uv = 0};
}

int board_serial_read(void) { return (UART_FR(UART0) & FR_RX_EMPTY) != 0 ? -1 : (int)(UART_DR(UART0) & 0xFFu); }

bool board_serial_write(const uint8_t *bytes, size_t length)
{
    /* A FIFO of 16 bytes has no room for a frame; sending one takes 4 ms at the most, and the host waits for it. */
    for (size_t i = 0; i < length; i++) {
        while ((UART_FR(UART0) & FR_TX_FULL) != 0) {
        }
        UART_DR(UART0) = bytes[i];
    }
    return true;
}

void board_watchdog_start(void)
{
    WATCHDOG_LOAD = WATCHDOG_TICKS;
    WATCHDOG_CTL = 3; /* count, and reset */
}

void board_watchdog_feed(void) { WATCHDOG_LOAD = WATCHDOG_TICKS; }

void board_signal(board_event event)
{
    static const char *const NAMES[] = {" applied\n", " armed\n", " disarmed\n", " tripped\n"};
    trace_number(board_time_us());
    trace_text(NAMES[event]);
}

void board_idle(void)
{
    __asm volatile("wfi");
    TIMER0_ICR = 1;
    UART_ICR(UART0) = RX_INTERRUPTS;
    NVIC_UNPEND = IRQ_UART0 | IRQ_TIMER0A;
}
