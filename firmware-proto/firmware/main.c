#include "app.h"

int main(void)
{
    static app self;
    board_init();
    app_init(&self);
    board_watchdog_start();
    for (;;) {
        app_step(&self);
        board_idle();
    }
}
