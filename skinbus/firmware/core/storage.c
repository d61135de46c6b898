/* Parameters and node-ID that outlast the supply (0x1010, 0x1011, LSS), in two pages of flash.
 *
 * A page is written whole, beside the one in force, and its checksum comes last: whenever the supply fails, one
 * page is whole, the old or the new. It holds a head, the runs of parameters that differ from their defaults,
 * and a run of index 0 that ends them. The page with the higher sequence number is in force.
 */
#include <string.h>

#include "skin.h"

#define MAGIC 0x32304253u /* "SB02" */
#define LSS_RUN 1u        /* index of the node-ID and the bit rate */
#define MARKS 0x1020
#define SAVE 0x65766173u
#define LOAD 0x64616F6Cu

static unsigned group_of(uint16_t index)
{
    return index == LSS_RUN    ? SB_LSS_GROUP
           : index < 0x1000    ? 0
           : index < 0x2000    ? SB_COMMUNICATION
           : index < 0x6000    ? SB_MANUFACTURER
           : index < 0xA000    ? SB_APPLICATION
                               : 0;
}

struct head {
    uint32_t magic, sequence, vendor, product;
};
struct stored { /* what comes before the bytes of a run */
    uint16_t index, sub, length;
};
struct page { /* one that is read or written, and where */
    struct sb_board *b;
    unsigned number;
    size_t at, next; /* next: of the run after this one */
    uint32_t crc;
    bool is_good;
    uint8_t word[8]; /* what is not written yet */
};

static void get(struct page *page, void *data, size_t n)
{
    page->is_good = page->is_good && page->at + n <= page->b->flash_bytes &&
                    flash_read(page->b, page->number, page->at, data, n);
    if (!page->is_good)
        memset(data, 0, n);
    page->crc = sb_crc(page->crc, data, n);
    page->at += n;
}

static void put(struct page *page, const void *data, size_t n)
{
    page->crc = sb_crc(page->crc, data, n);
    for (const uint8_t *from = data; n; n--) {
        page->word[page->at++ % 8] = *from++;
        if (page->at % 8 == 0)
            page->is_good = page->is_good && page->at <= page->b->flash_bytes &&
                            flash_write(page->b, page->number, page->at - 8, page->word);
    }
}

static void put_run(struct page *page, uint16_t index, uint16_t sub, const uint8_t *data, size_t n)
{
    const struct stored run = {index, sub, (uint16_t)n};
    put(page, &run, sizeof run);
    put(page, data, n);
}

/* Return whether there is another run, whose bytes come next. */
static bool next_run(struct page *page, struct stored *run)
{
    page->at = page->next;
    get(page, run, sizeof *run);
    page->next = page->at + run->length;
    return run->index != 0;
}

static bool is_whole(struct sb_board *b, unsigned number, struct head *head)
{
    struct page page = {.b = b, .number = number, .is_good = true};
    struct stored run = {.index = 1};
    uint32_t crc;
    get(&page, head, sizeof *head);
    if (head->magic != MAGIC)
        return false;
    while (run.index && page.is_good)
        for (get(&page, &run, sizeof run); run.length && page.is_good; run.length--)
            get(&page, &(uint8_t){0}, 1);
    const uint32_t wanted = page.crc;
    get(&page, &crc, sizeof crc);
    return page.is_good && crc == wanted;
}

enum { NONE = 2, DAMAGED = 3 };

/* Return the page in force, NONE if nothing was ever stored, DAMAGED if what was is not whole. */
static unsigned in_force(struct sb_board *b, struct head *head)
{
    unsigned found = NONE;
    head->sequence = 0;
    for (unsigned number = 0; b->flash_bytes && number < 2; number++) {
        struct head own;
        if (is_whole(b, number, &own)) {
            if (found > 1 || (int32_t)(own.sequence - head->sequence) > 0) {
                *head = own;
                found = number;
            }
        } else if (found == NONE && own.magic != UINT32_MAX)
            found = DAMAGED;
    }
    return found;
}

/* Open the page in force after its head; what it returns is not good if there is none of this device. */
static struct page open_stored(struct sb_board *b, struct head *head)
{
    const unsigned number = in_force(b, head);
    const bool is_ours = head->vendor == sb_get(b, 0x1018, 1) && head->product == sb_get(b, 0x1018, 2);
    return (struct page){.b = b, .number = number, .next = sizeof *head, .is_good = number < 2 && is_ours};
}

/* Write a page with what groups hold now; without those that are dropped, and of the others what was stored. */
static uint32_t rewrite(struct sb_board *b, unsigned fresh, unsigned dropped, bool is_mark_dropped)
{
    struct head head;
    struct page from = open_stored(b, &head);
    struct page to = {.b = b, .number = from.number == 0 ? 1 : 0, .is_good = true};
    const uint32_t sequence = head.sequence + 1;
    const uint8_t configured[2] = {b->next_node_id, b->bit_rate}, padding[8] = {0};
    struct stored stored;
    head = (struct head){MAGIC, sequence, sb_get(b, 0x1018, 1), sb_get(b, 0x1018, 2)};
    put(&to, &head, sizeof head);
    for (const struct sb_run *run = sb_runs; run < sb_runs + SB_N_RUNS; run++) {
        const uint8_t *at = &b->image[run->at];
        if (!(fresh & group_of(run->index)) || !(run->access & SB_PARAMETER) || sb_is_default(b, run))
            continue;
        put_run(&to, run->index, run->sub, at, run->size ? (size_t)run->n * run->size : 2 + sb_load(at, 2));
    }
    if (fresh & SB_LSS_GROUP)
        put_run(&to, LSS_RUN, 0, configured, sizeof configured);
    while (next_run(&from, &stored)) {
        if ((fresh | dropped) & group_of(stored.index) || (is_mark_dropped && stored.index == MARKS))
            continue;
        put(&to, &stored, sizeof stored);
        for (uint8_t byte; stored.length; stored.length--) {
            get(&from, &byte, 1);
            put(&to, &byte, 1);
        }
    }
    put_run(&to, 0, 0, padding, 7 - (to.at + sizeof stored + 3) % 8); /* up to the checksum, which ends a word */
    const uint32_t crc = to.crc;
    put(&to, &crc, sizeof crc);
    return to.is_good && is_whole(b, to.number, &head) && head.sequence == sequence ? 0 : ABORT_HARDWARE;
}

/* Take one stored run, if the dictionary of today would. */
static bool take_run(struct sb_board *b, struct page *page, const struct stored *stored)
{
    const struct sb_run *run = sb_find(stored->index, (uint8_t)stored->sub);
    if (stored->index == LSS_RUN && stored->length == 2) {
        get(page, &b->node_id, 1);
        get(page, &b->bit_rate, 1);
        b->next_node_id = b->node_id;
        return true;
    }
    if (!run || run->sub != stored->sub || !(run->access & SB_PARAMETER) ||
        (run->size ? stored->length != run->n * run->size : stored->length > 2 + SB_TEXT_ROOM))
        return false;
    if (!run->size)
        get(page, &b->image[run->at], stored->length);
    for (uint8_t *at = &b->image[run->at], *end = at + run->n * run->size; at < end; at += run->size) {
        uint8_t value[8];
        get(page, value, run->size);
        if (sb_check(run, value))
            return false;
        memcpy(at, value, run->size);
    }
    return true;
}

bool sb_storage_load(struct sb_board *b, unsigned groups)
{
    struct head head;
    struct stored stored;
    struct page page = open_stored(b, &head);
    bool is_good = page.is_good || page.number == NONE;
    while (next_run(&page, &stored))
        if (group_of(stored.index) & groups)
            is_good = take_run(b, &page, &stored) && is_good;
    return is_good;
}

uint32_t sb_storage_keep_node_id(struct sb_board *b)
{
    if (!b->flash_bytes)
        return 1; /* not supported */
    return rewrite(b, SB_LSS_GROUP, 0, false) ? 2 : 0;
}

uint32_t sb_storage_command(struct sb_board *b, uint16_t index, uint8_t sub, const uint8_t *data)
{
    static const uint8_t groups[] = {0, SB_COMMUNICATION | SB_APPLICATION | SB_MANUFACTURER, SB_COMMUNICATION,
                                     SB_APPLICATION, SB_MANUFACTURER};
    const bool is_save = index == 0x1010;
    const unsigned group = sub < sizeof groups ? groups[sub] : 0;
    if (sb_load(data, 4) != (is_save ? SAVE : LOAD))
        return ABORT_NOT_STORED;
    if (!b->flash_bytes)
        return ABORT_LOCAL_CONTROL;
    if (!group)
        return 0;
    /* with other parameters beside them stored marks would be wrong, unless those of now are right */
    const bool is_marked = is_save && (sb_get(b, MARKS, 1) || sb_get(b, MARKS, 2));
    return rewrite(b, is_save ? group : 0, is_save ? 0 : group, !(group & SB_COMMUNICATION) && !is_marked);
}
