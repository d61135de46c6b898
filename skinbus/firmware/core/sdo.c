/* The SDO server: one transfer at a time, expedited or in segments (CiA 301, 7.2.4.3). */
#include <string.h>

#include "skin.h"

#define TIMEOUT_MS 1000u
#define SEGMENT 7u

enum { DOWNLOAD_SEGMENT = 0, DOWNLOAD = 1, UPLOAD = 2, UPLOAD_SEGMENT = 3, ABORT = 4 }; /* bits 5 to 7 */
enum { EXPEDITED = 0x02, SIZE_GIVEN = 0x01, TOGGLE = 0x10, LAST = 0x01 };

uint32_t sb_sdo_id(const struct sb_board *b, uint8_t sub)
{
    return sb_find(0x1200, sub) ? sb_get(b, 0x1200, sub) : (sub == 1 ? 0x600u : 0x580u) + b->node_id;
}

static void answer(struct sb_board *b, unsigned command, const uint8_t *data, uint32_t n)
{
    uint8_t frame[8] = {(uint8_t)command};
    memcpy(&frame[1], data, n);
    sb_send(b, sb_sdo_id(b, 2), frame, 8, false);
}

static void answer_head(struct sb_board *b, unsigned command, uint32_t number)
{
    uint8_t data[SEGMENT] = {(uint8_t)b->sdo_index, (uint8_t)(b->sdo_index >> 8), b->sdo_sub};
    sb_store(&data[3], number, 4);
    answer(b, command, data, SEGMENT);
}

static void give_up(struct sb_board *b, uint32_t code)
{
    b->sdo_command = 0;
    answer_head(b, ABORT << 5, code);
}

static void begin(struct sb_board *b, uint8_t command, uint32_t least, uint32_t most)
{
    b->sdo_command = command;
    b->sdo_least = least;
    b->sdo_most = most;
    b->sdo_done = b->sdo_toggle = 0;
    b->sdo_deadline = sb_after(b, TIMEOUT_MS);
}

/* Begin a download: what fits the buffer is written when all of its bytes are there; longer texts come into their
 * place, where from here on there is none. */
static uint32_t begin_download(struct sb_board *b, bool is_announced, uint32_t n)
{
    const struct sb_run *run = sb_find(b->sdo_index, b->sdo_sub);
    const uint32_t size = run->size, room = sb_room(run);
    const uint32_t code = b->sdo_index == SB_PROGRAM_DATA ? sb_program_begin(b) : 0;
    if (code)
        return code;
    if (is_announced && n > room)
        return size ? ABORT_LENGTH_HIGH : ABORT_MEMORY;
    if (is_announced && n < size)
        return ABORT_LENGTH_LOW;
    begin(b, DOWNLOAD, is_announced ? n : size, is_announced ? n : room);
    b->sdo_data = b->sdo_buffer;
    if (room > sizeof b->sdo_buffer) {
        b->sdo_data = sb_at(b, b->sdo_index, b->sdo_sub) + 2;
        sb_store(b->sdo_data - 2, SB_NOWHERE, 2);
    }
    return 0;
}

/* Take bytes of a download; with the last ones the object is written. */
static uint32_t take(struct sb_board *b, const uint8_t *data, uint32_t n, bool is_last)
{
    if (b->sdo_done + n > b->sdo_most)
        return ABORT_LENGTH_HIGH;
    if (is_last && b->sdo_done + n < b->sdo_least)
        return ABORT_LENGTH_LOW;
    b->sdo_command = is_last ? 0 : DOWNLOAD;
    if (b->sdo_index == SB_PROGRAM_DATA)
        return sb_program_take(b, data, n, is_last);
    memcpy(&b->sdo_data[b->sdo_done], data, n);
    b->sdo_done += n;
    return is_last ? sb_write(b, b->sdo_index, b->sdo_sub, b->sdo_data, b->sdo_done) : 0;
}

static void download(struct sb_board *b, const uint8_t *data)
{
    const bool is_expedited = data[0] & EXPEDITED, is_size_given = data[0] & SIZE_GIVEN;
    uint32_t code = sb_permit(b->sdo_index, b->sdo_sub, SB_WRITE);
    if (!code)
        code = begin_download(b, is_size_given && !is_expedited, sb_load(&data[4], 4));
    if (!code && is_expedited) {
        const uint32_t n = is_size_given ? 4u - (data[0] >> 2 & 3) : b->sdo_most < 4 ? b->sdo_most : 4;
        code = take(b, &data[4], n, true);
    }
    if (code)
        give_up(b, code);
    else
        answer_head(b, 0x60, 0);
}

static void download_segment(struct sb_board *b, const uint8_t *data)
{
    const uint32_t code = take(b, &data[1], SEGMENT - (data[0] >> 1 & 7), data[0] & LAST);
    if (code)
        give_up(b, code);
    else
        answer(b, 0x20u | (data[0] & TOGGLE), data, 0);
}

static void upload(struct sb_board *b)
{
    uint32_t n;
    const uint32_t code = sb_read(b, b->sdo_index, b->sdo_sub, &b->sdo_data, &n);
    if (code)
        give_up(b, code);
    else if (n > 0 && n <= 4)
        answer_head(b, 0x40 | (4 - n) << 2 | EXPEDITED | SIZE_GIVEN, sb_load(b->sdo_data, n));
    else {
        begin(b, UPLOAD, n, n);
        answer_head(b, 0x40 | SIZE_GIVEN, n);
    }
}

static void upload_segment(struct sb_board *b, const uint8_t *data)
{
    const uint32_t left = b->sdo_most - b->sdo_done, n = left < SEGMENT ? left : SEGMENT;
    answer(b, (data[0] & TOGGLE) | (SEGMENT - n) << 1 | (left <= SEGMENT ? LAST : 0), &b->sdo_data[b->sdo_done], n);
    b->sdo_done += n;
    if (left <= SEGMENT)
        b->sdo_command = 0;
}

void sb_sdo_receive(struct sb_board *b, const struct sb_frame *frame)
{
    const uint8_t *data = frame->data;
    const uint8_t command = data[0] >> 5;
    if (frame->length != 8)
        return;
    if ((b->sdo_command == DOWNLOAD && command == DOWNLOAD_SEGMENT) ||
        (b->sdo_command == UPLOAD && command == UPLOAD_SEGMENT)) {
        if ((data[0] & TOGGLE) != b->sdo_toggle) {
            give_up(b, ABORT_TOGGLE);
            return;
        }
        b->sdo_toggle ^= TOGGLE;
        b->sdo_deadline = sb_after(b, TIMEOUT_MS);
        (command == DOWNLOAD_SEGMENT ? download_segment : upload_segment)(b, data);
        return;
    }
    if (command != DOWNLOAD_SEGMENT && command != UPLOAD_SEGMENT && command != ABORT) {
        b->sdo_index = (uint16_t)sb_load(&data[1], 2);
        b->sdo_sub = data[3];
    } else if (!b->sdo_command)
        b->sdo_index = b->sdo_sub = 0;
    b->sdo_command = 0; /* a new start is allowed in the middle of a transfer, which it ends */
    if (command == DOWNLOAD)
        download(b, data);
    else if (command == UPLOAD)
        upload(b);
    else if (command != ABORT)
        give_up(b, ABORT_COMMAND);
}

uint64_t sb_sdo_tick(struct sb_board *b)
{
    if (b->sdo_command && b->now >= b->sdo_deadline)
        give_up(b, ABORT_TIMEOUT);
    return b->sdo_command ? b->sdo_deadline : SB_NEVER;
}
