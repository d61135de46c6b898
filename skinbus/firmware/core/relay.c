/* A stop relay, in place of a board: its output is closed while all guarded patches are armed. Not certified.
 *
 * GFC, a patch that is not exactly armed and one that is silent for too long open it; then it stays open until
 * the supply was off. The other files of the core are not needed.
 */
#include <string.h>

#include "skin.h"

#define ARMED 1
#define POLL_US 500u

static uint32_t heard[SB_N_GUARDED]; /* us */
static bool is_armed[SB_N_GUARDED], is_closed, has_stopped;

void sb_init(struct sb_board *b, uint8_t node_id, uint32_t serial, size_t flash_bytes)
{
    (void)node_id, (void)serial, (void)flash_bytes;
    memset(is_armed, 0, sizeof is_armed);
    is_closed = has_stopped = false;
    relay_output(b, false);
}

void sb_receive(struct sb_board *b, const struct sb_frame *frame, uint32_t now_us)
{
    (void)b;
    has_stopped |= frame->id == SB_GFC && !frame->flags;
    for (unsigned i = 0; i < SB_N_GUARDED; i++)
        if (frame->id == sb_guarded[i] && !frame->flags) {
            heard[i] = now_us;
            is_armed[i] = frame->length && frame->data[0] == ARMED;
            has_stopped |= is_closed && !is_armed[i];
        }
}

uint32_t sb_poll(struct sb_board *b, uint32_t now_us)
{
    bool are_all = true;
    for (unsigned i = 0; i < SB_N_GUARDED; i++) {
        is_armed[i] = is_armed[i] && now_us - heard[i] <= SB_SILENT_US;
        are_all = are_all && is_armed[i];
    }
    has_stopped |= is_closed && !are_all;
    is_closed = are_all && !has_stopped;
    relay_output(b, is_closed);
    return POLL_US;
}
