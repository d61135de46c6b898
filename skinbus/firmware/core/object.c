/* The object dictionary: where values lie, who may read and write them, and what must be so of a value. */
#include <string.h>

#include "skin.h"

#define FIRST_APPLICATION 0x2000
#define HISTORY 0x1003
#define STORE 0x1010
#define RESTORE 0x1011
#define MARKS 0x1020

/* Return the first run that does not end before a sub-index; of another object if there is none. */
static const struct sb_run *place(uint16_t index, uint8_t sub)
{
    size_t low = 0, high = SB_N_RUNS - 1;
    while (low < high) {
        const size_t middle = (low + high) / 2;
        const struct sb_run *run = &sb_runs[middle];
        if (run->index < index || (run->index == index && run->sub + run->n <= sub))
            low = middle + 1;
        else
            high = middle;
    }
    return &sb_runs[low];
}

const struct sb_run *sb_find(uint16_t index, uint8_t sub)
{
    const struct sb_run *run = place(index, sub);
    return run->index == index && run->sub <= sub && sub < run->sub + run->n ? run : NULL;
}

static size_t offset(const struct sb_run *run, uint8_t sub)
{
    return run->at + (size_t)(sub - run->sub) * run->size;
}

uint8_t *sb_at(struct sb_board *b, uint16_t index, uint8_t sub)
{
    const struct sb_run *run = sb_find(index, sub);
    return run ? &b->image[offset(run, sub)] : NULL;
}

uint32_t sb_get(const struct sb_board *b, uint16_t index, uint8_t sub)
{
    const struct sb_run *run = sb_find(index, sub);
    return run ? sb_load(&b->image[offset(run, sub)], run->size < 4 ? run->size : 4) : 0;
}

void sb_put(struct sb_board *b, uint16_t index, uint8_t sub, uint32_t value)
{
    const struct sb_run *run = sb_find(index, sub);
    if (run)
        sb_store(&b->image[offset(run, sub)], value, run->size);
}

bool sb_set(struct sb_board *b, uint16_t index, uint8_t sub, const uint8_t *data, uint32_t n)
{
    const struct sb_run *run = sb_find(index, sub);
    uint8_t *to = sb_at(b, index, sub);
    if (!run || n > sb_room(run))
        return false;
    if (!run->size) {
        sb_store(to, n, 2);
        to += 2;
    }
    memmove(to, data, n); /* a text may be in its place already */
    sb_pdo_changed(b, index);
    sb_node_changed(b, index);
    sb_guard_changed(b, index);
    return true;
}

/* Put defaults where the bus can write or the node-ID counts; all else is the device's own and stays.
 * Limits of the guard are no parameter: they go with every reset. */
void sb_load_defaults(struct sb_board *b, bool is_application)
{
    for (const struct sb_run *run = sb_runs; run < sb_runs + SB_N_RUNS; run++) {
        uint8_t *to = &b->image[run->at];
        const bool is_kept = run->index >= FIRST_APPLICATION && run->access & SB_PARAMETER && !is_application;
        if (!(run->access & (SB_WRITE | SB_RELATIVE)) || is_kept)
            continue;
        if (!run->size)
            sb_store(to, SB_NOWHERE, 2);
        else
            memcpy(to, &sb_defaults[run->at], (size_t)run->n * run->size);
        if (run->access & SB_RELATIVE) /* a run of one number */
            sb_store(to, sb_load(to, run->size) + b->node_id, run->size);
    }
}

bool sb_is_default(const struct sb_board *b, const struct sb_run *run)
{
    const uint8_t *at = &b->image[run->at];
    if (!run->size)
        return sb_load(at, 2) == SB_NOWHERE;
    if (run->access & SB_RELATIVE)
        return sb_load(at, run->size) == sb_load(&sb_defaults[run->at], run->size) + b->node_id;
    return memcmp(at, &sb_defaults[run->at], (size_t)run->n * run->size) == 0;
}

uint32_t sb_room(const struct sb_run *run)
{
    return run->size ? run->size : (uint32_t)sb_limits[run->limit][1];
}

/* CRC-32 as zlib has it; begins and goes on with what it returned, 0 at first. */
uint32_t sb_crc(uint32_t crc, const uint8_t *data, size_t n)
{
    crc = ~crc;
    for (size_t i = 0; i < n; i++) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (crc & 1 ? 0xEDB88320u : 0);
    }
    return ~crc;
}

/* What a master verifies at every boot: entries as in a concise DCF (0x2060). */
static uint32_t checksum(const struct sb_board *b)
{
    uint32_t crc = 0;
    for (const struct sb_run *run = sb_runs; run < sb_runs + SB_N_RUNS; run++)
        for (uint8_t k = 0; run->access & SB_VERIFIED && k < run->n; k++) {
            uint8_t head[7] = {(uint8_t)run->index, (uint8_t)(run->index >> 8), (uint8_t)(run->sub + k), run->size};
            crc = sb_crc(sb_crc(crc, head, sizeof head), &b->image[run->at + k * run->size], run->size);
        }
    return crc;
}

/* Return why an object cannot be read or written, 0 if it can. */
uint32_t sb_permit(uint16_t index, uint8_t sub, uint8_t right)
{
    const struct sb_run *run = sb_find(index, sub);
    if (!run)
        return place(index, 0)->index == index ? ABORT_NO_SUB_INDEX : ABORT_NO_OBJECT;
    return run->access & right ? 0 : right == SB_READ ? ABORT_WRITE_ONLY : ABORT_READ_ONLY;
}

uint32_t sb_read(struct sb_board *b, uint16_t index, uint8_t sub, uint8_t **data, uint32_t *n)
{
    const uint32_t code = sb_permit(index, sub, SB_READ);
    if (code)
        return code;
    sb_put(b, SB_PROGRAM_CONTROL, 1, b->program_status);
    sb_put(b, SB_PROGRAM_SOFTWARE, 1, b->program_crc);
    if (index == SB_READINGS && sub)
        sb_sample(b);
    else if (index == SB_CHECKSUM)
        sb_put(b, index, sub, checksum(b));
    else if ((index == STORE || index == RESTORE) && sub)
        sb_put(b, index, sub, b->flash_bytes != 0);
    else if (index == HISTORY && sub > sb_get(b, HISTORY, 0))
        return ABORT_NO_DATA; /* CiA 301, 7.5.2.4 */
    *data = sb_at(b, index, sub);
    *n = sb_find(index, sub)->size;
    if (!*n) {
        *n = sb_load(*data, 2);
        *data += 2;
    }
    return *n == SB_NOWHERE ? ABORT_NO_DATA : 0;
}

uint32_t sb_check(const struct sb_run *run, const uint8_t *data)
{
    const unsigned n = run->size;
    const uint32_t bits = sb_load(data, n < 4 ? n : 4);
    const bool is_negative = run->access & SB_SIGNED && bits >> (8 * n - 1);
    const int64_t value = is_negative ? (int64_t)bits - ((int64_t)1 << 8 * n) : bits;
    if (run->access & SB_BOOLEAN && bits > 1)
        return ABORT_VALUE;
    if (run->access & SB_REAL && (data[n - 1] & 0x7F) == 0x7F && data[n - 2] >= (n == 4 ? 0x80 : 0xF0))
        return ABORT_VALUE; /* infinite or none */
    if (value > sb_limits[run->limit][1])
        return ABORT_VALUE_HIGH;
    return value < sb_limits[run->limit][0] ? ABORT_VALUE_LOW : 0;
}

/* What may be written to a COB-ID: no identifier of another service (CiA 301, table 40), and another one only
 * while it is not valid. */
uint32_t sb_check_cob_id(uint32_t value, uint32_t old, uint32_t allowed)
{
    const uint32_t id = value & 0x7FF;
    const bool is_restricted = id < 0x080 || (id > 0x100 && id < 0x181) || (id > 0x580 && id < 0x600) ||
                               (id > 0x600 && id < 0x680) || (id >= 0x6E0 && id < 0x700) || id > 0x700;
    if (value & ~(COB_INVALID | allowed | 0x7FF))
        return ABORT_VALUE;
    if (value & COB_INVALID)
        return 0;
    return is_restricted || (!(old & COB_INVALID) && (old ^ value) & 0x7FF) ? ABORT_VALUE : 0;
}

/* A manager reads 0x1020 to find whether it has to configure the board again (CiA 301, 7.5.2.24). */
void sb_clear_marks(struct sb_board *b)
{
    sb_put(b, MARKS, 1, 0);
    sb_put(b, MARKS, 2, 0);
}

/* Take the data of a download; those of a text may be in their place already. */
uint32_t sb_write(struct sb_board *b, uint16_t index, uint8_t sub, const uint8_t *data, uint32_t n)
{
    const struct sb_run *run = sb_find(index, sub);
    const uint32_t value = sb_load(data, n < 4 ? n : 4);
    uint32_t code;
    if ((code = sb_check(run, data)) != 0 || (code = sb_pdo_check(b, index, sub, value)) != 0 ||
        (code = sb_node_check(b, index, sub, value)) != 0 || (code = sb_guard_check(index, data, n)) != 0 ||
        (b->on_write && (code = b->on_write(b, index, sub, data)) != 0))
        return code;
    if (index == SB_GUARD)
        return sb_guard_acknowledge(b, value);
    if (index == STORE || index == RESTORE)
        return sb_storage_command(b, index, sub, data);
    if (index == SB_PROGRAM_CONTROL)
        return sb_program_command(b, data[0]);
    const bool is_new = !run->size || memcmp(sb_at(b, index, sub), data, n) != 0;
    if (is_new && index == MARKS)
        b->is_mark_old = false;
    else if (is_new && run->access & SB_PARAMETER) {
        b->is_mark_old |= index >= FIRST_APPLICATION;
        sb_clear_marks(b);
    }
    sb_set(b, index, sub, data, n);
    return 0;
}
