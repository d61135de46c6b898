/* A board with an STM32F072 (Cortex-M0, bxCAN): untried on hardware. 16 tactels and more through multiplexers.
 *
 * PA11, PA12: CAN, 1 Mbit/s from the internal 48 MHz oscillator, which is good enough for a short bus only if it is
 * trimmed: use a crystal for a product. PA0: the common output of the multiplexers; PB0 to PB5: their address;
 * PB7: the output of a stop relay, high while it is closed.
 * Register names and bits are those of the reference manual RM0091.
 */
#include <string.h>

#include "skin.h"

#define REG(address) (*(volatile uint32_t *)(uintptr_t)(address))
#define RCC(at) REG(0x40021000u + (at))
#define GPIOA(at) REG(0x48000000u + (at))
#define GPIOB(at) REG(0x48000400u + (at))
#define TIM2(at) REG(0x40000000u + (at))
#define CAN(at) REG(0x40006400u + (at))
#define ADC(at) REG(0x40012400u + (at))
#define FLASH(at) REG(0x40022000u + (at))
#define MAILBOX(k) (0x180u + 0x10u * (k))

#define FLASH_BYTES 8192u
#define LINKED 4u /* the place that a program is linked for */
#ifndef BOOT
#define BOOT 0
#endif
#define FLASH_PAGE 2048u
#define CONVERTER_BITS 12
#define SETTLE_US 10u
#define QUEUE 16u /* frames that wait for their mailbox: a SYNC asks for eight at most */

static const uint32_t places[] = {0x0801C000u, 0x0801E000u, 0x08001800u, 0x0800A000u, 0x08012800u}; /* of pages */
static struct sb_board board;
static struct sb_frame queue[QUEUE];
static unsigned first, n_queued;
static struct sb_frame last; /* in mailbox 0 */

uint32_t micros(struct sb_board *b)
{
    return TIM2(0x24); /* CNT, at 1 MHz */
}

static bool put(const struct sb_frame *frame, unsigned mailbox)
{
    if (!(CAN(0x08) >> (26 + mailbox) & 1)) /* TSR: TME */
        return false;
    CAN(MAILBOX(mailbox) + 4) = frame->length;
    CAN(MAILBOX(mailbox) + 8) = sb_load(frame->data, 4);
    CAN(MAILBOX(mailbox) + 12) = sb_load(&frame->data[4], 4);
    CAN(MAILBOX(mailbox)) = (uint32_t)frame->id << 21 | 1; /* TXRQ */
    if (mailbox == 0)
        last = *frame;
    return true;
}

static bool is_late(const struct sb_frame *frame)
{
    return frame->expires && (int32_t)(micros(&board) - frame->t_us) > 0;
}

/* A mailbox for each kind: of those that are full the controller sends the lowest identifier. */
bool can_send(struct sb_board *b, const struct sb_frame *frame, bool urgent)
{
    if (urgent)
        return put(frame, frame->id == SB_GFC ? 2 : 1);
    if (n_queued == QUEUE)
        return false;
    queue[(first + n_queued++) % QUEUE] = *frame;
    return true;
}

/* Let what waits go on to mailbox 0, in its order, and take out of it what is late. */
static void send_queued(void)
{
    if (is_late(&last))
        CAN(0x08) = 0x80; /* ABRQ0 */
    while (n_queued && (is_late(&queue[first]) || put(&queue[first], 0))) {
        first = (first + 1) % QUEUE;
        n_queued--;
    }
}

bool can_receive(struct sb_board *b, struct sb_frame *frame)
{
    if (!(CAN(0x0C) & 3)) /* RF0R: FMP */
        return false;
    const uint32_t id = CAN(0x1B0), length = CAN(0x1B4) & 15;
    memset(frame, 0, sizeof *frame);
    frame->id = (uint16_t)(id & 4 ? 0x7FF : id >> 21); /* of 29 bits: one that no board hears */
    frame->flags = id & 2 ? SB_REMOTE : 0;
    frame->length = (uint8_t)(length < 8 ? length : 8);
    sb_store(frame->data, CAN(0x1B8), 4);
    sb_store(&frame->data[4], CAN(0x1BC), 4);
    frame->t_us = micros(b) | 1; /* the loop is never far behind */
    CAN(0x0C) = 0x20;            /* RFOM */
    return true;
}

uint8_t sample(struct sb_board *b, int16_t readings[SB_N_TACTELS], uint16_t *age_100us)
{
    const unsigned bits = 8 * SB_READING_BYTES - 1;
    *age_100us = 0;
    for (unsigned k = 0; k < SB_N_TACTELS; k++) {
        GPIOB(0x18) = 0x3F0000u | k; /* BSRR: the address */
        for (const uint32_t begin = micros(b); micros(b) - begin < SETTLE_US;) {
        }
        ADC(0x08) = 4; /* CR: ADSTART */
        while (!(ADC(0x00) & 4)) { /* ISR: EOC */
        }
        const uint32_t raw = ADC(0x40) & 0xFFFu;
        readings[k] = (int16_t)(bits > CONVERTER_BITS ? raw << (bits - CONVERTER_BITS) : raw >> (CONVERTER_BITS - bits));
    }
    return b->now < 20000 ? SB_UNSETTLED : 0;
}

bool flash_read(struct sb_board *b, unsigned page, size_t at, uint8_t *data, size_t n)
{
    memcpy(data, (const void *)(uintptr_t)(places[page] + at), n);
    return true;
}

bool flash_write(struct sb_board *b, unsigned page, size_t at, const uint8_t data[8])
{
    const uint32_t to = places[page] + at;
    FLASH(0x04) = 0x45670123u; /* KEYR */
    FLASH(0x04) = 0xCDEF89ABu;
    for (uint32_t erased = 0; at == 0 && erased < (page < SB_PROGRAMS ? FLASH_BYTES : SB_PROGRAM_BYTES); erased += FLASH_PAGE) {
        FLASH(0x10) = 2; /* CR: PER */
        FLASH(0x14) = to + erased;
        FLASH(0x10) = 0x42; /* STRT */
        while (FLASH(0x0C) & 1) { /* SR: BSY */
        }
    }
    FLASH(0x10) = 1; /* PG */
    for (unsigned i = 0; i < 8; i += 2) {
        *(volatile uint16_t *)(uintptr_t)(to + i) = (uint16_t)sb_load(&data[i], 2);
        while (FLASH(0x0C) & 1) { /* SR: BSY */
        }
    }
    FLASH(0x10) = 0x80; /* LOCK */
    return memcmp((const void *)(uintptr_t)to, data, 8) == 0;
}

void restart(struct sb_board *b)
{
    do
        send_queued();
    while (~CAN(0x08) >> 26 & 7); /* TSR: TME of all mailboxes, the first of which takes what is queued */
    REG(0xE000ED0Cu) = 0x05FA0004u; /* AIRCR: SYSRESETREQ */
}

void relay_output(struct sb_board *b, bool closed)
{
    GPIOB(0x18) = closed ? 1u << 7 : 1u << 23; /* BSRR */
}

static void start_hardware(void)
{
    RCC(0x34) |= 1u << 16; /* CR2: HSI48ON, and all from it */
    while (!(RCC(0x34) >> 17 & 1)) {
    }
    FLASH(0x00) = 0x11; /* one wait state, prefetch */
    RCC(0x04) = 3;
    RCC(0x14) |= 3u << 17;              /* GPIOA, GPIOB */
    RCC(0x18) |= 1u << 9;               /* ADC */
    RCC(0x1C) |= 1u << 25 | 1u;         /* CAN, TIM2 */
    GPIOA(0x00) |= 0x02800003u;         /* PA0 analogue, PA11 and PA12 alternate function */
    GPIOA(0x24) |= 4u << 12 | 4u << 16; /* 4: CAN */
    GPIOB(0x00) |= 0x4555;              /* PB0 to PB5 and PB7 outputs */
    TIM2(0x28) = 47;                    /* 48 MHz / 48 */
    TIM2(0x2C) = UINT32_MAX;
    TIM2(0x14) = 1;
    TIM2(0x00) = 1;
    ADC(0x08) = 1u << 31; /* ADCAL */
    while (ADC(0x08) >> 31) {
    }
    ADC(0x08) = 1; /* ADEN */
    ADC(0x28) = 1; /* channel 0 */
    ADC(0x14) = 2; /* 13.5 cycles */
    CAN(0x00) = 0x41; /* MCR: INRQ, ABOM (recovers from bus-off) */
    while (!(CAN(0x04) & 1)) {
    }
    CAN(0x1C) = 2u | 12u << 16 | 1u << 20; /* BTR: 48 MHz / 3, 1 + 13 + 2 quanta, sample point 87.5 % */
    CAN(0x200) |= 1;                       /* one filter that passes all */
    CAN(0x20C) |= 1;
    CAN(0x240) = CAN(0x244) = 0;
    CAN(0x21C) |= 1;
    CAN(0x200) &= ~1u;
    CAN(0x00) = 0x40;
}

extern uint32_t data_from[], data_begin[], data_end[], bss_begin[], bss_end[];
int main(void);

void reset(void)
{
    for (uint32_t *to = data_begin, *from = data_from; to < data_end;)
        *to++ = *from++;
    for (uint32_t *to = bss_begin; to < bss_end;)
        *to++ = 0;
    main();
}

__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {
    (void (*)(void))0x20004000u, reset}; /* the end of the RAM; there are no interrupts, and a fault ends all */

/* Of the boot program: bring the program that is to start to the place that it is linked for. */
static int start_program(void)
{
    const uint32_t page = sb_program_choose(&board, true), from = places[page] + 32, to = places[LINKED];
    const uint32_t n = page ? REG(places[page] + 8) - 16 : 0;
    if (memcmp((const void *)(uintptr_t)to, (const void *)(uintptr_t)from, n) != 0)
        for (uint32_t at = 0; at < n; at += 8)
            flash_write(&board, LINKED, at, (const uint8_t *)(uintptr_t)(from + at));
    __asm__ volatile("msr msp, %0\n\tbx %1" : : "r"(REG(to)), "r"(REG(to + 4)));
    return 0;
}

int main(void)
{
    const uint32_t serial = REG(0x1FFFF7ACu) ^ REG(0x1FFFF7B0u) ^ REG(0x1FFFF7B4u); /* of the part */
    if (BOOT)
        return start_program(); /* the rest of this program is left out */
    start_hardware();
    sb_init(&board, SB_UNCONFIGURED, serial, FLASH_BYTES);
    for (;;) {
        sb_turn(&board);
        send_queued();
    }
}
