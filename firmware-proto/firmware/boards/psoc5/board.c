/*
 * PSoC5LP (CY8CKIT-059), built by PSoC Creator with the components that README.md lists. Every function is one or two
 * component calls; what needs thought is in app.c.
 */
#include "board.h"

#include <project.h>

#define TICKS_PER_US 24u /* the bus clock, 24 MHz */
#define SYSTICK_MASK 0x00FFFFFFu
#define VDAC_STEP_UV 16000 /* VDAC8, range 0 to 4.080 V */
#define LVI_4_2_V 10u      /* 1.70 V + 10 x 0.25 V */

static uint32 last_tick;
static uint64_t ticks;
static uint8 received[64];
static uint16 received_length, received_read;

void board_init(void)
{
    CyGlobalIntEnable;
    VDAC8_1_Start();
    VDAC8_2_Start();
    VDAC8_3_Start();
    VDAC8_4_Start();
    for (unsigned i = 0; i < BP_CHANNELS; i++) {
        board_dac_set(i, 0);
    }
    Opamp_1_Start();
    Opamp_2_Start();
    Opamp_3_Start();
    Opamp_4_Start();
    AMux_1_Start();
    ADC_DelSig_1_Start();
    CyVdLvAnalogEnable(0u, LVI_4_2_V);
    CySysTickStart();
    CySysTickDisableInterrupt();
    CySysTickSetReload(SYSTICK_MASK);
    CySysTickClear();
    last_tick = CySysTickGetValue();
    USBUART_1_Start(0u, USBUART_1_5V_OPERATION);
}

uint64_t board_time_us(void)
{
    /* Counts down, and around once in 0.7 s. */
    const uint32 tick = CySysTickGetValue();
    ticks += (last_tick - tick) & SYSTICK_MASK;
    last_tick = tick;
    return ticks / TICKS_PER_US;
}

void board_dac_set(unsigned channel, int32_t microvolts)
{
    const uint8 code = (uint8)((microvolts + VDAC_STEP_UV / 2) / VDAC_STEP_UV);
    switch (channel) {
    case 0:
        VDAC8_1_SetValue(code);
        break;
    case 1:
        VDAC8_2_SetValue(code);
        break;
    case 2:
        VDAC8_3_SetValue(code);
        break;
    default:
        VDAC8_4_SetValue(code);
        break;
    }
}

int32_t board_adc_read(unsigned channel)
{
    AMux_1_Select((uint8)channel);
    ADC_DelSig_1_StartConvert();
    (void)ADC_DelSig_1_IsEndConversion(ADC_DelSig_1_WAIT_FOR_RESULT);
    ADC_DelSig_1_StopConvert();
    return ADC_DelSig_1_CountsTo_uVolts(ADC_DelSig_1_GetResult32());
}

bool board_supply_good(void) { return (CyVdRealTimeStatus() & CY_VD_LVIA) == 0u; }

bool board_reset_by_brown_out(void) { return (CyResetStatus & (CY_RESET_LVID | CY_RESET_LVIA)) != 0u; }

bp_calibration board_calibration(unsigned channel)
{
    /* Eight bytes a channel: gain, offset; an EEPROM that was never written reads zeros. */
    bp_calibration stored = {0u, 0};
    for (unsigned i = 0; i < sizeof stored; i++) {
        ((uint8 *)&stored)[i] = EEPROM_1_ReadByte((uint16)(channel * sizeof stored + i));
    }
    if (stored.gain_ppm == 0u) {
        stored.gain_ppm = 1000000u;
        stored.offset_uv = 0;
    }
    return stored;
}

int board_serial_read(void)
{
    if (received_read == received_length) {
        received_read = received_length = 0u;
        if (USBUART_1_IsConfigurationChanged() != 0u && USBUART_1_GetConfiguration() != 0u) {
            (void)USBUART_1_CDC_Init();
        }
        if (USBUART_1_GetConfiguration() != 0u && USBUART_1_DataIsReady() != 0u) {
            received_length = USBUART_1_GetAll(received);
        }
    }
    return received_read < received_length ? (int)received[received_read++] : -1;
}

bool board_serial_write(const uint8_t *bytes, size_t length)
{
    /* A frame is one packet; 45 bytes at most, so that no empty packet has to end the transfer. */
    if (USBUART_1_GetConfiguration() == 0u || USBUART_1_CDCIsReady() == 0u) {
        return false;
    }
    USBUART_1_PutData(bytes, (uint16)length);
    return true;
}

void board_watchdog_start(void) { CyWdtStart(CYWDT_128_TICKS, CYWDT_LPMODE_NOCHANGE); }
void board_watchdog_feed(void) { CyWdtClear(); }

/* The kit's lamp: on while armed. */
void board_signal(board_event event)
{
    if (event != BOARD_APPLIED) {
        LED_Write(event == BOARD_ARMED ? 1u : 0u);
    }
}

void board_idle(void) {}
