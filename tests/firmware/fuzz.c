/* Random frames into a board, most of them nearly right; what it sends and its state must stay within bounds.
 * Arguments: seed, number of frames. Compiled with sanitizers. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "library.c"

static uint32_t state;

static uint32_t random_below(uint32_t n)
{
    state ^= state << 13;
    state ^= state >> 17;
    state ^= state << 5;
    return state % n;
}

static void need(int is_so, const char *what)
{
    if (!is_so) {
        fprintf(stderr, "%s\n", what);
        exit(1);
    }
}

static void make(struct sb_frame *frame, uint8_t node_id)
{
    static const uint8_t numbers[] = {0, 0, 1, 2, 8, 64, 127, 128, 240, 254, 255};
    const uint16_t ids[] = {0, 0x80, 0x80, 0x200u + node_id, 0x600u + node_id, 0x600u + node_id, 0x600u + node_id,
                            0x700u + node_id, 0x7E5, 0x709, (uint16_t)random_below(0x800)};
    memset(frame, 0, sizeof *frame);
    frame->id = ids[random_below(sizeof ids / sizeof *ids)];
    frame->length = (uint8_t)random_below(frame->id == 0x80 ? 3 : 9);
    frame->flags = (uint8_t)(random_below(20) ? 0 : random_below(4));
    for (unsigned i = 0; i < 8; i++)
        frame->data[i] = random_below(2) ? numbers[random_below(sizeof numbers)] : (uint8_t)random_below(256);
    if (frame->id == 0 && random_below(8)) {
        static const uint8_t commands[] = {1, 1, 1, 2, 128, 129, 130};
        frame->length = 2;
        frame->data[0] = commands[random_below(sizeof commands)];
        frame->data[1] = 0;
    } else if (frame->id == 0x600u + node_id) {
        static const uint8_t starts[] = {0x2F, 0x2B, 0x23, 0x22, 0x21, 0x20, 0x40, 0x40, 0x60, 0x70, 0x00, 0x10};
        const struct sb_run *run = &sb_runs[random_below(SB_N_RUNS)];
        frame->length = random_below(50) ? 8 : frame->length;
        frame->data[0] = random_below(30) ? starts[random_below(sizeof starts)] : (uint8_t)random_below(256);
        sb_store(&frame->data[1], run->index, 2);
        frame->data[3] = (uint8_t)(run->sub + random_below(run->n + 1u));
        if ((run->index == 0x1010 || run->index == 0x1011) && random_below(4))
            memcpy(&frame->data[4], run->index == 0x1010 ? "save" : "load", 4);
        else if (run->index == SB_PROGRAM_CONTROL)
            frame->data[4] = (uint8_t[]){0, 0, 3, 1, 0x80}[random_below(5)];
        else if (run->index >= 0x1600 && run->index < 0x1C00 && random_below(2)) {
            const struct sb_run *to = &sb_runs[random_below(SB_N_RUNS)];
            sb_store(&frame->data[4], (uint32_t)to->index << 16 | (uint32_t)to->sub << 8 | 8u * to->size, 4);
        }
    } else if (frame->id == 0x7E5)
        frame->length = random_below(8) ? 8 : frame->length;
}

/* Write limits of the guard, most of them right. */
static void write_limits(struct sb_board *b)
{
    uint8_t data[SB_GUARD_ROOM];
    uint32_t crc = 0;
    for (unsigned i = 0; i < sizeof data; i++)
        data[i] = (uint8_t)random_below(i < 2 ? 9 : 256);
    for (unsigned i = 0; i < SB_N_TACTELS; i++)
        data[7 + 2 * SB_N_TACTELS + 2 * i] &= random_below(50) ? 1 : 3;
    for (unsigned bit = 0; bit < 8 * (sizeof data - 2); bit++) {
        crc ^= bit % 8 ? 0 : (uint32_t)data[bit / 8] << 8;
        crc = (crc << 1 ^ (crc >> 15 ? 0x1021 : 0)) & 0xFFFF;
    }
    sb_store(&data[sizeof data - 2], crc, 2);
    sb_write(b, SB_GUARD_LIMITS, 0, data, random_below(20) ? sizeof data : random_below(sizeof data));
}

static void power_on(struct library *library, uint8_t node_id, uint8_t *flash, size_t page)
{
    library->n_writes = UINT32_MAX;
    library_init(library, node_id, 1, flash, page);
}

int main(int n, char **words)
{
    need(n == 3, "arguments: seed, number of frames");
    state = (uint32_t)strtoul(words[1], NULL, 0) * 2654435761u + 1;
    const unsigned long n_frames = strtoul(words[2], NULL, 0);
    const size_t page = 8192;
    struct library *library = calloc(1, library_size());
    struct sb_board *b = &library->board;
    uint8_t *flash = malloc(2 * page + 2 * SB_PROGRAM_BYTES);
    uint32_t now = 0xFFFF0000u; /* soon wraps around */
    unsigned long n_sent = 0, n_stops = 0;
    memset(flash, 0xFF, 2 * page + 2 * SB_PROGRAM_BYTES);
    power_on(library, 5, flash, page);
    for (unsigned long i = 0; i < n_frames; i++) {
        struct sb_frame frame;
        if (random_below(3000) == 0 || b->node_id == SB_UNCONFIGURED || library->is_restarting) {
            power_on(library, random_below(10) ? 5 : SB_UNCONFIGURED, flash, page);
            if (b->node_id == SB_UNCONFIGURED && random_below(4))
                power_on(library, 5, flash, 0);
        }
        if (random_below(500) == 0)
            library->n_writes = random_below(60);
        library->status = (uint8_t)(random_below(2) ? 0 : random_below(4));
        library->age_100us = (uint16_t)random_below(random_below(2) ? 40 : 65536);
        library->readings[random_below(SB_N_TACTELS)] = (int16_t)random_below(65536);
        if (random_below(50) == 0)
            write_limits(b);
        if (random_below(100) == 0)
            sb_write(b, SB_GUARD, 3, (const uint8_t *)"ackn", 4);
        make(&frame, b->node_id);
        now += random_below(4) ? random_below(3000) : random_below(2000000);
        frame.t_us = random_below(2) ? now : (uint32_t)random_below(UINT32_MAX);
        sb_receive(b, &frame, now);
        need(sb_poll(b, now) > 0, "wants to be called at once");
        need(b->state == 0 || b->state == 4 || b->state == 5 || b->state == 127, "no state of NMT");
        need(!(sb_get(b, SB_GUARD, 1) & 1) || b->state == SB_OPERATIONAL, "armed where it sends nothing");
        need(b->n_errors <= SB_ERRORS && b->n_waiting <= SB_WAITING, "too many errors");
        for (unsigned k = 0; k < library->n_out; k++) {
            const struct sb_frame *out = &library->out[k];
            need(out->id != SB_GFC || sb_get(b, SB_GUARD, 1) & 2, "a stop without a trip");
            n_stops += out->id == SB_GFC;
            need(out->id < 0x800 && out->length <= SB_FRAME_BYTES && !(out->flags & SB_REMOTE), "a wrong frame");
            need(b->node_id != SB_UNCONFIGURED || out->id == 0x7E4 || frame.id == 0x7E5 || frame.id == 0,
                 "speaks without a node-ID");
        }
        n_sent += library->n_out;
        library->n_out = 0;
    }
    need(n_sent > n_frames / 20, "hardly any answer");
    need(n_stops >= n_frames / 2000, "hardly any trip");
    printf("%lu frames, %lu answers, %lu stops\n", n_frames, n_sent, n_stops);
    free(flash);
    free(library);
    return 0;
}
