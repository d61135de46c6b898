/* Parameters and node-ID that outlast the supply (0x1010, 0x1011, LSS), in two pages of flash.
 *
 * A page is written whole, beside the one in force, and its checksum comes last: whenever the supply fails, one
 * page is whole, the old or the new. It holds a head and, for each run of parameters, how many bytes are stored,
 * 0 for the defaults, and those bytes; its last word is their length and a checksum. The page with the higher
 * sequence number is in force. What a program with another dictionary has stored is not taken, but the node-ID is.
 */
#include <string.h>

#include "skin.h"

#define MAGIC 0x33304253u /* "SB03" */
#define MARKS 0x1020
#define SAVE 0x65766173u
#define LOAD 0x64616F6Cu

struct head {
    uint32_t magic, sequence, dictionary;
    uint8_t node_id, bit_rate, unused[2]; /* by LSS; node_id 0: not stored */
};
struct page { /* one that is read or written, and where */
    struct sb_board *b;
    unsigned number;
    size_t at;
    uint32_t crc;
    bool is_good;
    uint8_t word[8]; /* what is not written yet */
};
enum { NONE = 2, DAMAGED = 3 }; /* in place of its number: nothing was ever stored; what was is not whole */

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

static bool is_whole(struct sb_board *b, unsigned number, struct head *head)
{
    struct page page = {.b = b, .number = number, .is_good = true}, end = page;
    uint32_t length, crc;
    end.at = b->flash_bytes - 8;
    get(&end, &length, 4);
    get(&end, &crc, 4);
    get(&page, head, sizeof *head);
    while (page.is_good && page.at < length)
        get(&page, &(uint8_t){0}, 1);
    return page.is_good && head->magic == MAGIC && page.crc == crc;
}

/* Open the page in force after its head; what it returns is not good if there is none. */
static struct page open_stored(struct sb_board *b, struct head *head)
{
    struct page page = {.b = b, .number = NONE, .at = sizeof *head};
    *head = (struct head){.magic = MAGIC};
    for (unsigned number = 0; b->flash_bytes && number < 2; number++) {
        struct head own;
        const bool is_good = is_whole(b, number, &own);
        if (is_good && (!page.is_good || (int32_t)(own.sequence - head->sequence) > 0)) {
            *head = own;
            page.number = number;
            page.is_good = true;
        } else if (!page.is_good && own.magic != UINT32_MAX)
            page.number = DAMAGED;
    }
    return page;
}

/* Write a page with what groups hold now; without those that are dropped, and of the others what was stored. */
static uint32_t rewrite(struct sb_board *b, unsigned fresh, unsigned dropped, bool is_mark_dropped)
{
    struct head head;
    struct page from = open_stored(b, &head), to = {.b = b, .number = from.number == 0, .is_good = true};
    const uint32_t sequence = ++head.sequence;
    from.is_good = from.is_good && head.dictionary == SB_DICTIONARY;
    head.dictionary = SB_DICTIONARY;
    if (fresh & SB_LSS_GROUP) {
        head.node_id = b->next_node_id;
        head.bit_rate = b->bit_rate;
    }
    put(&to, &head, sizeof head);
    for (const struct sb_run *run = sb_runs; run < sb_runs + SB_N_RUNS; run++) {
        const unsigned group = run->access & SB_PARAMETER;
        const bool is_kept = !((fresh | dropped) & group) && !(is_mark_dropped && run->index == MARKS);
        const uint8_t *at = &b->image[run->at];
        uint16_t n = 0, n_stored;
        if (!group)
            continue;
        get(&from, &n_stored, 2);
        if (is_kept)
            n = n_stored;
        else if (fresh & group && !sb_is_default(b, run))
            n = (uint16_t)(run->size ? run->n * run->size : 2 + sb_load(at, 2));
        put(&to, &n, 2);
        if (!is_kept)
            put(&to, at, n);
        for (uint8_t byte; n_stored; n_stored--) {
            get(&from, &byte, 1);
            if (is_kept)
                put(&to, &byte, 1);
        }
    }
    while (to.at % 8)
        put(&to, "", 1);
    const uint32_t end[2] = {(uint32_t)to.at, to.crc};
    to.at = b->flash_bytes - 8;
    put(&to, end, 8);
    return to.is_good && is_whole(b, to.number, &head) && head.sequence == sequence ? 0 : ABORT_HARDWARE;
}

bool sb_storage_load(struct sb_board *b, unsigned groups)
{
    struct head head;
    struct page page = open_stored(b, &head);
    if (groups & SB_LSS_GROUP && head.node_id) {
        b->node_id = b->next_node_id = head.node_id;
        b->bit_rate = head.bit_rate;
    }
    page.is_good = page.is_good && head.dictionary == SB_DICTIONARY;
    for (const struct sb_run *run = sb_runs; page.is_good && run < sb_runs + SB_N_RUNS; run++) {
        uint16_t n = 0;
        if (run->access & SB_PARAMETER)
            get(&page, &n, 2);
        if (n && run->access & groups && (run->size || n <= 2 + sb_room(run)))
            get(&page, &b->image[run->at], n);
        else
            page.at += n;
    }
    return page.is_good || page.number == NONE;
}

uint32_t sb_storage_keep_node_id(struct sb_board *b)
{
    if (!b->flash_bytes)
        return 1; /* not supported */
    return rewrite(b, SB_LSS_GROUP, 0, false) ? 2 : 0;
}

uint32_t sb_storage_command(struct sb_board *b, uint16_t index, uint8_t sub, const uint8_t *data)
{
    static const uint16_t groups[] = {0, SB_PARAMETER, SB_COMMUNICATION, SB_APPLICATION, SB_MANUFACTURER};
    const bool is_save = index == 0x1010;
    const unsigned group = sub < sizeof groups / sizeof *groups ? groups[sub] : 0;
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
