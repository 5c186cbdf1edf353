/* Vector table and start of the C program. */
#include <stdint.h>

/* A symbol of the linker script; a function only so that it fits into the table. */
void stack_top(void);
extern uint32_t data_load, data_start, data_end, bss_start, bss_end;
int main(void);

void reset_handler(void)
{
    const uint32_t *from = &data_load;
    for (uint32_t *to = &data_start; to < &data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *to = &bss_start; to < &bss_end;) {
        *to++ = 0;
    }
    (void)main();
    for (;;) {
    }
}

/* A fault stops the program; the hardware watchdog then resets the board, with its outputs at zero. */
static void fault_handler(void)
{
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static void (*const VECTORS[16])(void) = {
    stack_top,     reset_handler, fault_handler, fault_handler, fault_handler, fault_handler,
    fault_handler, 0,             0,             0,             0,             fault_handler,
    fault_handler, 0,             fault_handler, fault_handler,
};
