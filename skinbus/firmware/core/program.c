/* Program download (CiA 302-3: 0x1F50, 0x1F51, 0x1F56, 0x1F57) into two slots of flash.
 *
 * A slot holds an image, as the Makefile makes it, whose second number is the board's own: a sequence number. A new program is
 * written beside the one that runs, and started next. The last words of its slot are marks: it was started, it is
 * confirmed. What was started and not confirmed is given up at the next start. Whenever the supply fails, one
 * slot is whole.
 */
#include "skin.h"

#define MAGIC 0x31504253u /* "SBP1" */
#define SUMMED 16u        /* bytes before those that length and checksum are of */
enum { STOP = 0, START = 1, RESET = 2, CLEAR = 3 };
enum { TRIED = SB_PROGRAM_ROOM, CONFIRMED = TRIED + 8 }; /* where the marks are, eight bytes each */

struct head { uint32_t magic, sequence, length, crc, vendor, product, version, unused; };

/* Return whether a program is whole; of one that is not the head is 0. */
static bool is_whole(struct sb_board *b, unsigned slot, struct head *head)
{
    uint32_t crc = 0;
    uint8_t byte;
    bool is_good = SB_PROGRAM_BYTES && flash_read(b, SB_PROGRAMS + slot, 0, (uint8_t *)head, sizeof *head) &&
                   head->magic == MAGIC && head->vendor == SB_VENDOR && head->product == SB_PRODUCT &&
                   head->length <= SB_PROGRAM_ROOM - SUMMED;
    for (uint32_t i = 0; is_good && i < head->length; i++) {
        is_good = flash_read(b, SB_PROGRAMS + slot, SUMMED + i, &byte, 1);
        crc = sb_crc(crc, &byte, 1);
    }
    if (!is_good || crc != head->crc)
        *head = (struct head){0};
    return head->magic;
}

static bool put(struct sb_board *b, unsigned slot, size_t at, uint32_t magic, uint32_t sequence)
{
    const uint32_t word[2] = {magic, sequence};
    return flash_write(b, SB_PROGRAMS + slot, at, (const uint8_t *)word);
}

unsigned sb_program_choose(struct sb_board *b, bool is_start)
{
    struct head head, other;
    uint32_t marks[SB_PROGRAM_MARKS / 4] = {0}; /* two of each */
    const bool has_first = is_whole(b, 0, &head), has_second = is_whole(b, 1, &other);
    unsigned slot = 0;
    if (!has_first || (int32_t)(other.sequence - head.sequence) > 0) { /* of one that is not whole it is 0 */
        head = other;
        slot = 1;
    }
    if (head.magic)
        flash_read(b, SB_PROGRAMS + slot, TRIED, (uint8_t *)marks, sizeof marks);
    const bool is_tried = !marks[0], is_new = marks[2], has_both = has_first && has_second;
    const bool is_left = is_new && (is_start ? (is_tried || !put(b, slot, TRIED, 0, 0)) && has_both : !is_tried);
    if (is_start && is_left)
        put(b, slot, 0, MAGIC, 0);
    b->program_slot = slot ^ is_left;
    b->program_sequence = head.sequence;
    b->program_crc = head.crc;
    b->program_status = is_new && !is_left && has_both ? SB_ON_TRIAL : START;
    b->has_new_program = is_left;
    b->is_slot_used = false;
    return head.magic ? SB_PROGRAMS + b->program_slot : 0;
}

void sb_program_confirm(struct sb_board *b)
{
    if (b->program_status == SB_ON_TRIAL && put(b, b->program_slot, CONFIRMED, 0, 0))
        b->program_status = START;
}

uint32_t sb_program_command(struct sb_board *b, uint8_t command)
{
    if (command != SB_ON_TRIAL && (command > CLEAR || command == RESET))
        return ABORT_VALUE;
    if (b->state != SB_PRE_OPERATIONAL || (b->program_status == SB_ON_TRIAL && command != SB_ON_TRIAL))
        return ABORT_DEVICE_STATE;
    if (command == SB_ON_TRIAL) { /* where flash fails, 0x1F51 still says that it is on trial */
        sb_program_confirm(b);
        return 0;
    }
    if (!SB_PROGRAM_BYTES && command == CLEAR)
        return ABORT_LOCAL_CONTROL;
    if (command == CLEAR && !put(b, !b->program_slot, 0, MAGIC, b->program_sequence + 1))
        return ABORT_HARDWARE;
    if (command == CLEAR)
        sb_program_choose(b, false);
    b->program_status = command;
    b->is_restarting = command == START && b->has_new_program;
    return 0;
}

/* An image comes, after a clear command only; what is left of one that failed is erased. */
uint32_t sb_program_begin(struct sb_board *b)
{
    if (b->program_status != CLEAR)
        return ABORT_READ_ONLY;
    if (b->is_slot_used && !put(b, !b->program_slot, 0, MAGIC, b->program_sequence + 1))
        return ABORT_HARDWARE;
    b->is_slot_used = true;
    return 0;
}

/* Write whole words of an image; the first one is the slot's own since it was cleared. */
uint32_t sb_program_take(struct sb_board *b, const uint8_t *data, uint32_t n, bool is_last)
{
    while (n--) {
        const uint32_t at = b->sdo_done++;
        b->sdo_buffer[at % 8] = *data++;
        if (at % 8 == 7 && at > 7 && !flash_write(b, SB_PROGRAMS + !b->program_slot, at - 7, b->sdo_buffer))
            return ABORT_HARDWARE;
    }
    if (!is_last)
        return 0;
    sb_program_choose(b, false);
    b->is_slot_used = true;
    b->program_status = b->has_new_program ? STOP : CLEAR;
    return b->has_new_program ? 0 : ABORT_NOT_STORED;
}
