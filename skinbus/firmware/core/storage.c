/* Parameters and node-ID that outlast the supply (0x1010, 0x1011, LSS), in two pages of flash.
 *
 * A page is written whole, beside the one in force, and its checksum comes last: whenever the supply fails, one
 * page is whole, the old or the new. It holds a head, the runs of parameters that differ from their defaults,
 * and a run of index 0 that ends them. The page with the higher sequence number is in force.
 */
#include <string.h>

#include "skin.h"

#define MAGIC 0x31304253u /* "SB01" */
#define HEAD 16u          /* magic, sequence number, vendor, product */
#define RUN 5u            /* index, sub-index, length */
#define LSS_RUN 1u        /* index of the node-ID */
#define MARKS 0x1020
#define SAVE 0x65766173u
#define LOAD 0x64616F6Cu

enum { COMMUNICATION = 1, APPLICATION = 2, MANUFACTURER = 4, LSS = 8 };

static unsigned group_of(uint16_t index)
{
    return index == LSS_RUN    ? LSS
           : index < 0x1000    ? 0
           : index < 0x2000    ? COMMUNICATION
           : index < 0x6000    ? MANUFACTURER
           : index < 0xA000    ? APPLICATION
                               : 0;
}

struct page { /* one that is read or written, and where */
    struct sb_board *b;
    unsigned number;
    size_t at;
    uint32_t crc;
    bool is_good;
    uint8_t word[8]; /* what is not written yet */
};

static void get(struct page *page, uint8_t *data, size_t n)
{
    page->is_good = page->is_good && page->at + n <= page->b->flash_bytes &&
                    flash_read(page->b, page->number, page->at, data, n);
    if (!page->is_good)
        memset(data, 0, n);
    page->crc = sb_crc(page->crc, data, n);
    page->at += n;
}

static void put(struct page *page, const uint8_t *data, size_t n)
{
    page->crc = sb_crc(page->crc, data, n);
    for (size_t i = 0; i < n; i++) {
        page->word[page->at % 8] = data[i];
        if (++page->at % 8 == 0)
            page->is_good = page->is_good && page->at <= page->b->flash_bytes &&
                            flash_write(page->b, page->number, page->at - 8, page->word);
    }
}

static struct page open_page(struct sb_board *b, unsigned number)
{
    struct page page;
    memset(&page, 0, sizeof page);
    page.b = b;
    page.number = number;
    page.is_good = true;
    return page;
}

/* Return whether a page is whole, and its sequence number. */
static bool is_whole(struct sb_board *b, unsigned number, uint32_t *sequence)
{
    struct page page = open_page(b, number);
    uint8_t data[HEAD];
    get(&page, data, HEAD);
    if (sb_load(data, 4) != MAGIC)
        return false;
    *sequence = sb_load(&data[4], 4);
    for (uint32_t index = 1, n; index && page.is_good;) {
        get(&page, data, RUN);
        index = sb_load(data, 2);
        for (n = sb_load(&data[3], 2); n && page.is_good; n--)
            get(&page, data, 1);
    }
    while (page.at % 8 != 4)
        get(&page, data, 1);
    const uint32_t crc = page.crc;
    get(&page, data, 4);
    return page.is_good && sb_load(data, 4) == crc;
}

enum { NONE = 2, DAMAGED = 3 };

/* Return the page in force, NONE if nothing was ever stored, DAMAGED if what was is not whole. */
static unsigned in_force(struct sb_board *b, uint32_t *sequence)
{
    unsigned found = NONE;
    for (unsigned number = 0; b->flash_bytes && number < 2; number++) {
        uint32_t own = 0;
        uint8_t first[8];
        if (is_whole(b, number, &own)) {
            if (found > 1 || (int32_t)(own - *sequence) > 0) {
                *sequence = own;
                found = number;
            }
        } else if (found == NONE) {
            static const uint8_t blank[8] = {0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF};
            if (!flash_read(b, number, 0, first, 8) || memcmp(first, blank, 8) != 0)
                found = DAMAGED;
        }
    }
    return found;
}

static void head(const struct sb_board *b, uint32_t sequence, uint8_t data[HEAD])
{
    sb_store(data, MAGIC, 4);
    sb_store(&data[4], sequence, 4);
    sb_store(&data[8], sb_get(b, 0x1018, 1), 4);
    sb_store(&data[12], sb_get(b, 0x1018, 2), 4);
}

/* Open the page in force after its head; false if it is of another device. */
static bool open_stored(struct sb_board *b, unsigned number, struct page *page)
{
    uint8_t data[HEAD], own[HEAD];
    *page = open_page(b, number);
    get(page, data, HEAD);
    head(b, 0, own);
    return memcmp(&data[8], &own[8], 8) == 0;
}

static bool next_run(struct page *page, uint16_t *index, uint8_t *sub, uint16_t *n)
{
    uint8_t data[RUN];
    get(page, data, RUN);
    *index = (uint16_t)sb_load(data, 2);
    *sub = data[2];
    *n = (uint16_t)sb_load(&data[3], 2);
    return *index != 0;
}

static void put_head_of_run(struct page *page, uint16_t index, uint8_t sub, size_t n)
{
    const uint8_t data[RUN] = {(uint8_t)index, (uint8_t)(index >> 8), sub, (uint8_t)n, (uint8_t)(n >> 8)};
    put(page, data, RUN);
}

static void put_run(struct page *page, uint16_t index, uint8_t sub, const uint8_t *data, size_t n)
{
    put_head_of_run(page, index, sub, n);
    put(page, data, n);
}

/* Write a page with what groups hold now; without those that are dropped, and of the others what was stored. */
static uint32_t rewrite(struct sb_board *b, unsigned fresh, unsigned dropped, bool is_mark_dropped)
{
    uint32_t sequence = 0;
    uint8_t data[HEAD];
    const unsigned old = in_force(b, &sequence);
    struct page from, to = open_page(b, old == 0 ? 1 : 0);
    head(b, ++sequence, data);
    put(&to, data, HEAD);
    for (size_t i = 0; i < SB_N_RUNS; i++) {
        const struct sb_run *run = &sb_runs[i];
        const size_t n = (size_t)run->n * sb_size(run->type);
        if (!(fresh & group_of(run->index)) || !sb_is_parameter(run) || sb_is_default(b, run))
            continue;
        if (n)
            put_run(&to, run->index, run->sub, &b->image[run->at], n);
        else {
            const unsigned slot = sb_texts[run->at].slot;
            put_run(&to, run->index, run->sub, b->text[slot - 1], b->text_length[slot]);
        }
    }
    if (fresh & LSS) {
        const uint8_t configured[2] = {b->next_node_id, b->lss_bit_rate};
        put_run(&to, LSS_RUN, 0, configured, 2);
    }
    uint16_t index, n;
    uint8_t sub;
    const bool is_kept = old < 2 && open_stored(b, old, &from);
    while (is_kept && next_run(&from, &index, &sub, &n)) {
        const bool is_out = (fresh | dropped) & group_of(index) || (is_mark_dropped && index == MARKS);
        if (!is_out)
            put_head_of_run(&to, index, sub, n);
        for (; n; n--) {
            get(&from, data, 1);
            if (!is_out)
                put(&to, data, 1);
        }
    }
    put_head_of_run(&to, 0, 0, 0);
    while (to.at % 8 != 4)
        put(&to, (const uint8_t[1]){0}, 1);
    sb_store(data, to.crc, 4);
    put(&to, data, 4);
    uint32_t written;
    return to.is_good && is_whole(b, to.number, &written) && written == sequence ? 0 : ABORT_HARDWARE;
}

/* Take one stored run, if the dictionary of today would. */
static bool take_run(struct sb_board *b, struct page *page, uint16_t index, uint8_t sub, uint16_t n)
{
    const struct sb_run *run = sb_find(index, sub);
    const unsigned size = run ? sb_size(run->type) : 0;
    bool is_good = run && run->sub == sub && sb_is_parameter(run) && (size ? n == run->n * size : n <= SB_TEXT_ROOM);
    for (unsigned at = 0; is_good && size && at < n; at += size) {
        uint8_t value[8];
        get(page, value, size);
        if (sb_check(run, value) == 0)
            memcpy(&b->image[run->at + at], value, size);
        else
            is_good = false;
    }
    if (is_good && !size) {
        const unsigned slot = sb_texts[run->at].slot;
        get(page, b->text[slot - 1], n);
        b->text_length[slot] = n;
    }
    return is_good;
}

bool sb_storage_load(struct sb_board *b, bool is_application)
{
    const unsigned groups = is_application ? COMMUNICATION | APPLICATION | MANUFACTURER : COMMUNICATION;
    uint32_t sequence = 0;
    uint16_t index, n;
    uint8_t sub;
    struct page page;
    bool is_good = true;
    const unsigned number = in_force(b, &sequence);
    if (number > 1)
        return number == NONE;
    if (!open_stored(b, number, &page))
        return false;
    while (next_run(&page, &index, &sub, &n)) {
        const size_t next = page.at + n;
        if (group_of(index) & groups)
            is_good = take_run(b, &page, index, sub, n) && is_good;
        page.at = next;
    }
    return is_good;
}

/* Take the node-ID that was stored, if one was. */
void sb_storage_power_on(struct sb_board *b)
{
    uint32_t sequence = 0;
    uint16_t index, n;
    uint8_t sub, data[2];
    struct page page;
    const unsigned number = in_force(b, &sequence);
    if (number > 1)
        return;
    page = open_page(b, number);
    page.at = HEAD;
    while (next_run(&page, &index, &sub, &n)) {
        const size_t next = page.at + n;
        if (index == LSS_RUN && n == 2) {
            get(&page, data, 2);
            b->node_id = b->next_node_id = data[0];
            b->lss_bit_rate = data[1];
        }
        page.at = next;
    }
}

uint32_t sb_storage_keep_node_id(struct sb_board *b)
{
    if (!b->flash_bytes)
        return 1; /* not supported */
    return rewrite(b, LSS, 0, false) ? 2 : 0;
}

uint32_t sb_storage_command(struct sb_board *b, uint16_t index, uint8_t sub, const uint8_t *data)
{
    static const uint8_t groups[] = {0, COMMUNICATION | APPLICATION | MANUFACTURER, COMMUNICATION, APPLICATION,
                                     MANUFACTURER};
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
    return rewrite(b, is_save ? group : 0, is_save ? 0 : group, !(group & COMMUNICATION) && !is_marked);
}
