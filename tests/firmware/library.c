/* A board as a shared library: whoever loads it gives frames, time and readings, and takes frames. For tests. */
#include <string.h>

#include "skin.h"

#define ROOM 64

struct library { /* callers set and read what comes before the board */
    uint32_t n_writes; /* words of flash written until the supply fails; further ones fail */
    uint32_t n_out;
    uint16_t age_100us;
    uint8_t status;
    bool is_restarting;
    int16_t readings[SB_N_TACTELS];
    struct sb_frame out[ROOM];
    uint8_t *flash; /* two pages, and two slots for programs */
    struct sb_board board;
};

static struct library *library_of(struct sb_board *b)
{
    return b->port;
}

bool can_send(struct sb_board *b, const struct sb_frame *frame, bool urgent)
{
    struct library *library = library_of(b);
    if (library->n_out + (urgent ? 0 : 1) >= ROOM)
        return false;
    library->out[library->n_out++] = *frame;
    return true;
}

uint8_t sample(struct sb_board *b, int16_t readings[SB_N_TACTELS], uint16_t *age_100us)
{
    const struct library *library = library_of(b);
    memcpy(readings, library->readings, sizeof library->readings);
    *age_100us = library->age_100us;
    return library->status;
}

static uint8_t *place(struct sb_board *b, unsigned page)
{
    const size_t slot = page < SB_PROGRAMS ? 0 : page - SB_PROGRAMS;
    return &library_of(b)->flash[(page - slot) * b->flash_bytes + slot * SB_PROGRAM_BYTES];
}

bool flash_read(struct sb_board *b, unsigned page, size_t at, uint8_t *data, size_t n)
{
    if (library_of(b)->flash)
        memcpy(data, place(b, page) + at, n);
    return library_of(b)->flash;
}

bool flash_write(struct sb_board *b, unsigned page, size_t at, const uint8_t data[8])
{
    struct library *library = library_of(b);
    uint8_t *to = place(b, page);
    const size_t n_bytes = page < SB_PROGRAMS ? b->flash_bytes : SB_PROGRAM_BYTES;
    if (!library->n_writes || !library->flash)
        return false;
    const bool is_torn = --library->n_writes == 0; /* the supply fails within this word, or this erasing */
    if (at == 0)
        memset(to, 0xFF, is_torn ? n_bytes / 2 : n_bytes);
    for (unsigned i = 0; i < (is_torn ? 3 : 8); i++)
        to[at + i] &= data[i]; /* flash only clears bits */
    return !is_torn;
}

void restart(struct sb_board *b)
{
    library_of(b)->is_restarting = true; /* whoever loads the library starts it again */
}

/* Main loops have can_receive and micros; whoever loads the library has both, for sb_receive and sb_poll. */

size_t library_size(void)
{
    return sizeof(struct library);
}

struct sb_board *library_init(struct library *library, uint8_t node_id, uint32_t serial, uint8_t *flash, size_t n)
{
    library->board.port = library;
    library->flash = flash;
    library->is_restarting = false;
    library->board.flash_bytes = n; /* place() needs it already */
    sb_program_choose(&library->board, true);
    sb_init(&library->board, node_id, serial, n);
    return &library->board;
}

uint32_t library_state(const struct sb_board *b)
{
    return b->state | (uint32_t)b->node_id << 8;
}

/* Put the identifiers that the board listens to, those of remote frames with bit 15; return how many. */
unsigned library_ids(struct sb_board *b, uint16_t ids[])
{
    const uint16_t guarding = (uint16_t)(0x700u + b->node_id);
    unsigned n = 0, n_heard = 0;
    ids[n++] = 0;
    ids[n++] = (uint16_t)(sb_get(b, 0x1005, 0) & 0x7FF);
    ids[n++] = (uint16_t)(sb_sdo_id(b, 1) & 0x7FF);
    ids[n++] = 0x7E5;
    for (unsigned i = 0; i < SB_N_PDOS; i++)
        ids[n++] = b->pdos[i].id;
    for (unsigned i = 1; i <= SB_CONSUMED_ROOM; i++)
        ids[n++] = (uint16_t)(0x700u + (b->watched[i].value >> 16 & 0x7F));
    for (unsigned i = 0; i < n; i++)
        if (sb_hears(b, ids[i], false))
            ids[n_heard++] = ids[i];
    if (sb_hears(b, guarding, true))
        ids[n_heard++] = (uint16_t)(guarding | 0x8000u);
    return n_heard;
}

void library_on_write(struct sb_board *b, uint32_t (*hook)(struct sb_board *, uint16_t, uint8_t, const uint8_t *))
{
    b->on_write = hook;
}
