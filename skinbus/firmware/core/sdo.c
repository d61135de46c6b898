/* The SDO server: one transfer at a time, expedited or in segments (CiA 301, 7.2.4.3). */
#include <string.h>

#include "skin.h"

#define TIMEOUT_US 1000000u
#define SEGMENT 7u
#define MOST 65536u

enum { DOWNLOAD = 1, UPLOAD = 2 };
enum { EXPEDITED = 0x02, SIZE_GIVEN = 0x01, TOGGLE = 0x10, LAST = 0x01, ABORT = 0x80 };

uint32_t sb_sdo_id(const struct sb_board *b, uint8_t sub)
{
    return sb_find(0x1200, sub) ? sb_get(b, 0x1200, sub) : (sub == 1 ? 0x600u : 0x580u) + b->node_id;
}

static void answer(struct sb_board *b, const uint8_t data[8])
{
    sb_send(b, sb_sdo_id(b, 2), data, 8, false);
}

static void answer_head(struct sb_board *b, uint8_t command, uint32_t number)
{
    uint8_t data[8] = {command};
    sb_store(&data[1], b->sdo_index, 2);
    data[3] = b->sdo_sub;
    sb_store(&data[4], number, 4);
    answer(b, data);
}

static void give_up(struct sb_board *b, uint32_t code)
{
    b->sdo_command = 0;
    answer_head(b, ABORT, code);
}

static void begin(struct sb_board *b, uint8_t command, uint32_t length)
{
    b->sdo_command = command;
    b->sdo_length = length;
    b->sdo_done = 0;
    b->sdo_toggle = 0;
    b->sdo_deadline = b->now + TIMEOUT_US;
}

/* Return where the bytes of a download go: a text into its room, all else into the buffer. */
static uint8_t *room(struct sb_board *b, size_t *n)
{
    const struct sb_run *run = sb_find(b->sdo_index, b->sdo_sub);
    if (sb_size(run->type)) {
        *n = sizeof b->sdo_buffer;
        return b->sdo_buffer;
    }
    *n = SB_TEXT_ROOM;
    return b->text[sb_texts[run->at].slot - 1];
}

/* Take bytes of a download; what is longer than a number is counted, and refused at its end. */
static bool take(struct sb_board *b, const uint8_t *data, uint32_t n)
{
    size_t most;
    uint8_t *to = room(b, &most);
    if (to != b->sdo_buffer) { /* from here on the old text is gone */
        b->text_length[sb_texts[sb_find(b->sdo_index, b->sdo_sub)->at].slot] = SB_NOWHERE;
        if (b->sdo_done + n > most)
            return false;
    }
    if (b->sdo_done + n <= most)
        memcpy(&to[b->sdo_done], data, n);
    b->sdo_done += n;
    return b->sdo_done <= MOST;
}

static void finish(struct sb_board *b, const uint8_t reply[8])
{
    size_t most;
    const uint32_t code = sb_write(b, b->sdo_index, b->sdo_sub, room(b, &most), b->sdo_done);
    if (code) {
        give_up(b, code);
        return;
    }
    b->sdo_command = 0;
    answer(b, reply);
}

static void download(struct sb_board *b, const uint8_t *data)
{
    const bool is_expedited = data[0] & EXPEDITED, is_size_given = data[0] & SIZE_GIVEN;
    const uint32_t announced = is_size_given && !is_expedited ? sb_load(&data[4], 4) : SB_UNKNOWN_LENGTH;
    const uint32_t code = sb_admit(b->sdo_index, b->sdo_sub, announced);
    if (code) {
        give_up(b, code);
        return;
    }
    begin(b, DOWNLOAD, announced);
    if (!is_expedited) {
        answer_head(b, 0x60, 0);
        return;
    }
    const unsigned size = sb_size(sb_find(b->sdo_index, b->sdo_sub)->type);
    uint8_t reply[8] = {0x60, data[1], data[2], data[3]};
    take(b, &data[4], is_size_given ? 4u - (data[0] >> 2 & 3) : size && size < 4 ? size : 4u);
    finish(b, reply);
}

static void download_segment(struct sb_board *b, const uint8_t *data)
{
    const uint32_t n = SEGMENT - (data[0] >> 1 & 7);
    const bool is_announced = b->sdo_length != SB_UNKNOWN_LENGTH;
    const uint8_t reply[8] = {(uint8_t)(0x20 | (data[0] & TOGGLE))};
    if ((data[0] & TOGGLE) != b->sdo_toggle) {
        give_up(b, ABORT_TOGGLE);
        return;
    }
    b->sdo_toggle ^= TOGGLE;
    if (is_announced && b->sdo_done + n > b->sdo_length)
        give_up(b, ABORT_LENGTH_HIGH);
    else if (!take(b, &data[1], n))
        give_up(b, ABORT_MEMORY);
    else if (!(data[0] & LAST)) {
        b->sdo_deadline = b->now + TIMEOUT_US;
        answer(b, reply);
    } else if (is_announced && b->sdo_done < b->sdo_length)
        give_up(b, ABORT_LENGTH_LOW);
    else
        finish(b, reply);
}

static void upload(struct sb_board *b)
{
    const uint8_t *data;
    uint32_t n;
    const uint32_t code = sb_read(b, b->sdo_index, b->sdo_sub, b->sdo_buffer, &data, &n);
    if (code)
        give_up(b, code);
    else if (n > 0 && n <= 4)
        answer_head(b, (uint8_t)(0x40 | (4 - n) << 2 | EXPEDITED | SIZE_GIVEN), sb_load(data, n));
    else {
        begin(b, UPLOAD, n);
        answer_head(b, 0x40 | SIZE_GIVEN, n);
    }
}

static void upload_segment(struct sb_board *b, uint8_t command)
{
    const struct sb_run *run = sb_find(b->sdo_index, b->sdo_sub);
    const uint32_t left = b->sdo_length - b->sdo_done, n = left < SEGMENT ? left : SEGMENT;
    const uint8_t *from = b->sdo_buffer;
    uint8_t data[8] = {(uint8_t)(b->sdo_toggle | (SEGMENT - n) << 1 | (left <= SEGMENT ? LAST : 0))};
    if ((command & TOGGLE) != b->sdo_toggle) {
        give_up(b, ABORT_TOGGLE);
        return;
    }
    if (!sb_size(run->type)) {
        const struct sb_text *text = &sb_texts[run->at];
        from = text->slot ? b->text[text->slot - 1] : (const uint8_t *)text->text;
    }
    memcpy(&data[1], &from[b->sdo_done], n);
    b->sdo_toggle ^= TOGGLE;
    b->sdo_done += n;
    b->sdo_deadline = b->now + TIMEOUT_US;
    if (left <= SEGMENT)
        b->sdo_command = 0;
    answer(b, data);
}

void sb_sdo_receive(struct sb_board *b, const struct sb_frame *frame)
{
    const uint8_t *data = frame->data;
    const uint8_t command = data[0] >> 5;
    if (frame->length != 8) {
        b->dropped++;
        return;
    }
    if (b->sdo_command == DOWNLOAD && command == 0) {
        download_segment(b, data);
        return;
    }
    if (b->sdo_command == UPLOAD && command == 3) {
        upload_segment(b, data[0]);
        return;
    }
    if (command == ABORT >> 5) {
        b->sdo_command = 0;
        return;
    }
    const bool is_block = (command == 5 && !(data[0] & 3)) || (command == 6 && !(data[0] & 1));
    if (command == DOWNLOAD || command == UPLOAD || command == 7 || is_block) {
        b->sdo_index = (uint16_t)sb_load(&data[1], 2);
        b->sdo_sub = data[3];
    } else if (!b->sdo_command) {
        b->sdo_index = 0;
        b->sdo_sub = 0;
    }
    b->sdo_command = 0; /* a new start is allowed in the middle of a transfer, which it ends */
    if (command == DOWNLOAD)
        download(b, data);
    else if (command == UPLOAD)
        upload(b);
    else
        give_up(b, ABORT_COMMAND);
}

void sb_sdo_tick(struct sb_board *b)
{
    if (b->sdo_command && b->now >= b->sdo_deadline)
        give_up(b, ABORT_TIMEOUT);
}
