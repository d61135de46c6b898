/* A board layer to fill in: seven functions and a main loop. Each comment says what the hardware has to do. */
#include "skin.h"

#define NODE_ID SB_UNCONFIGURED /* LSS gives one; or a number from switches, 1 to 127 */
#define SERIAL 0                /* from the unique number of your part: LSS finds boards by it */
#define FLASH_BYTES 0           /* of each of two pages that nothing else uses; 0: nothing is stored */

static struct sb_board board;

bool can_send(struct sb_board *b, const struct sb_frame *frame, bool urgent)
{
    /* Put the frame into a free mailbox or a queue of yours, or return false: a SYNC asks for all TPDOs at once.
     * Keep one mailbox for urgent frames, and one for SB_GFC, which is urgent and must win. All others go out in the
     * order of the calls, or readings overtake each other. If frame->expires, take it out of queue and mailbox when
     * micros() passes frame->t_us. SB_FD: a frame of CAN FD with a bit rate switch. */
    return false;
}

bool can_receive(struct sb_board *b, struct sb_frame *frame)
{
    /* Take the oldest frame out of the controller: 11-bit identifiers only, remote frames with SB_REMOTE.
     * frame->t_us is micros() at its last bit, taken in the interrupt, and never 0. */
    return false;
}

uint32_t micros(struct sb_board *b)
{
    /* A timer of 1 us that wraps around at 32 bits. */
    return 0;
}

uint8_t sample(struct sb_board *b, int16_t readings[SB_N_TACTELS], uint16_t *age_100us)
{
    /* Called on SYNC: convert all tactels now, in less than 4 ms. A converter of 12 bits: raw << 3; for a board
     * with 8-bit readings raw >> 5. Tactel k of the EDS is readings[k - 1]. Return SB_UNSETTLED until the supply
     * and the converter have settled. A converter that runs by itself sets *age_100us, the time since it sampled;
     * SB_OLD if nobody knows. */
    for (unsigned k = 0; k < SB_N_TACTELS; k++)
        readings[k] = 0;
    return SB_UNSETTLED;
}

bool flash_read(struct sb_board *b, unsigned page, size_t at, uint8_t *data, size_t n)
{
    return false;
}

bool flash_write(struct sb_board *b, unsigned page, size_t at, const uint8_t data[8])
{
    /* At 0 erase the page first. Words come in order. */
    return false;
}

void restart(struct sb_board *b)
{
    /* Let frames out that wait, and reset the processor. A boot program that is never replaced then calls sb_program_choose, and starts the
     * program in that page, from byte 32 on. ports/stm32f072.c has one. */
}

void relay_output(struct sb_board *b, bool closed)
{
    /* Of a stop relay: closed lets the robot run. Open is what it is without power. */
}

int main(void)
{
    sb_init(&board, NODE_ID, SERIAL, FLASH_BYTES);
    for (;;)
        sb_turn(&board); /* then feed the watchdog, and sleep until an interrupt */
}
