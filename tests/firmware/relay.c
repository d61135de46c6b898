/* The port of a stop relay as a shared library: whoever loads it gives frames and time, and sees the output. */
#include "skin.h"

static struct sb_board board;
static bool is_closed;

void relay_output(struct sb_board *b, bool closed)
{
    (void)b;
    is_closed = closed;
}

void start(void)
{
    sb_init(&board, 0, 0, 0);
}

/* Take a frame, if there is one (id 0xFFFF: none), and return whether the output is closed. */
bool step(uint32_t now_us, uint16_t id, uint8_t length, uint8_t state)
{
    const struct sb_frame frame = {.id = id, .length = length, .data = {state}};
    if (id != 0xFFFF)
        sb_receive(&board, &frame, now_us);
    sb_poll(&board, now_us);
    return is_closed;
}
