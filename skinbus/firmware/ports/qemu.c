/* A board in QEMU's mps2-an386 (Cortex-M4): slcan on UART 0, a noisy converter without tactels, parameters in RAM.
 *
 * The UART keeps one byte, and QEMU waits until it is taken: hardware would not. There is no CAN FD. Interrupts are
 * masked: they end a wfi, and that is all that they are for. Register names are those of Arm's CMSDK and MPS2.
 */
#include <string.h>

#include "skin.h"

#define REG(address) (*(volatile uint32_t *)(uintptr_t)(address))
#define UART(at) REG(0x40004000u + (at))
#define FPGAIO(at) REG(0x40028000u + (at))
#define SYSTEM(at) REG(0xE000E000u + (at)) /* SysTick, NVIC, SCB */

#define NODE_ID 1
#ifndef CLOCK_MHZ
#define CLOCK_MHZ 25u /* with more its time passes more slowly */
#endif
#define TURN_US 500u /* from one turn of the main loop to the next at most */
#define FLASH_BYTES 8192u

static struct sb_board board;
static uint8_t flash[2][FLASH_BYTES];

uint32_t micros(struct sb_board *b)
{
    return FPGAIO(0x18); /* COUNTER */
}

static void put(char byte)
{
    while (UART(0x04) & 1) { /* STATE: TX buffer full */
    }
    UART(0x00) = (uint8_t)byte;
}

static void put_hex(uint32_t value, unsigned n_digits)
{
    while (n_digits--)
        put("0123456789ABCDEF"[value >> 4 * n_digits & 15]);
}

static uint32_t hex(const uint8_t *digits, unsigned n_digits)
{
    uint32_t value = 0;
    for (; n_digits--; digits++)
        value = value << 4 | ((*digits & 15u) + (*digits > '9' ? 9 : 0));
    return value;
}

bool can_send(struct sb_board *b, const struct sb_frame *frame, bool urgent)
{
    put('t');
    put_hex(frame->id, 3);
    put_hex(frame->length, 1);
    for (unsigned i = 0; i < frame->length; i++)
        put_hex(frame->data[i], 2);
    put('\r');
    return true;
}

bool can_receive(struct sb_board *b, struct sb_frame *frame)
{
    static uint8_t line[32];
    static unsigned n;
    while (UART(0x04) & 2) { /* STATE: RX buffer full */
        const uint8_t byte = (uint8_t)UART(0x00);
        if (byte != '\r') {
            line[n++ % sizeof line] = byte;
            continue;
        }
        n = 0;
        if ((line[0] != 't' && line[0] != 'r') || line[4] > '8') /* a command of slcan, or of 29 bits */
            continue;
        *frame = (struct sb_frame){.id = (uint16_t)hex(&line[1], 3), .flags = line[0] == 'r' ? SB_REMOTE : 0,
                                   .length = (uint8_t)hex(&line[4], 1), .t_us = micros(b) | 1};
        for (unsigned i = 0; i < 8; i++) /* those after its length mean nothing */
            frame->data[i] = (uint8_t)hex(&line[5 + 2 * i], 2);
        return true;
    }
    return false;
}

uint8_t sample(struct sb_board *b, int16_t readings[SB_N_TACTELS], uint16_t *age_100us)
{
    static uint32_t random;
    for (unsigned k = 0; k < SB_N_TACTELS; k++) {
        random = 1664525 * random + 1013904223;
        readings[k] = (int16_t)(((int)(random >> 30) - 1) * (SB_READING_BYTES == 1 ? 1 : 16));
    }
    *age_100us = 0;
    return 0;
}

bool flash_read(struct sb_board *b, unsigned page, size_t at, uint8_t *data, size_t n)
{
    memcpy(data, &flash[page][at], n);
    return true;
}

bool flash_write(struct sb_board *b, unsigned page, size_t at, const uint8_t data[8])
{
    memcpy(&flash[page][at], data, 8);
    return true;
}

void restart(struct sb_board *b) {} /* of another program, which it has no slots for */

int main(void)
{
    __asm__ volatile("cpsid i");
    FPGAIO(0x1C) = CLOCK_MHZ - 1;           /* PRESCALE: COUNTER counts microseconds */
    SYSTEM(0x14) = CLOCK_MHZ * TURN_US - 1; /* SysTick: RVR */
    SYSTEM(0x10) = 7;                       /* CSR: from this clock, with an interrupt */
    SYSTEM(0x100) = 1;                      /* NVIC: ISER, received by UART 0 */
    UART(0x10) = 16;                        /* BAUDDIV */
    UART(0x08) = 0xB;                       /* CTRL: transmit, receive with an interrupt */
    memset(flash, 0xFF, sizeof flash);
    sb_init(&board, NODE_ID, 1, FLASH_BYTES);
    for (;;) {
        UART(0x0C) = 2;           /* INTCLEAR; what comes from here on ends the wfi */
        SYSTEM(0x280) = 1;        /* NVIC: ICPR */
        SYSTEM(0xD04) = 1u << 25; /* ICSR: PENDSTCLR */
        sb_turn(&board);
        __asm__ volatile("wfi");
    }
}

__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {
    (void (*)(void))0x20400000u, (void (*)(void))main}; /* the end of the RAM */
