/* The object dictionary: where values lie, who may read and write them, and what must be so of a value. */
#include <string.h>

#include "skin.h"

#define FIRST_APPLICATION 0x2000
#define HISTORY 0x1003
#define STORE 0x1010
#define RESTORE 0x1011
#define MARKS 0x1020

uint32_t sb_load(const uint8_t *data, unsigned n)
{
    uint32_t value = 0;
    while (n--)
        value = value << 8 | data[n];
    return value;
}

void sb_store(uint8_t *data, uint32_t value, unsigned n)
{
    for (unsigned i = 0; i < n; i++, value >>= 8)
        data[i] = (uint8_t)value;
}

unsigned sb_size(uint8_t type)
{
    static const uint8_t sizes[] = {0, 1, 1, 2, 4, 1, 2, 4, 4, 0, 0, 0, 6, 6, 0, 0,
                                    3, 8, 5, 6, 7, 8, 3, 0, 5, 6, 7, 8};
    return type < sizeof sizes ? sizes[type] : 0;
}

static size_t place(uint16_t index, uint8_t sub)
{
    size_t low = 0, high = SB_N_RUNS;
    while (low < high) {
        const size_t middle = (low + high) / 2;
        const struct sb_run *run = &sb_runs[middle];
        if (run->index < index || (run->index == index && run->sub + run->n <= sub))
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

const struct sb_run *sb_find(uint16_t index, uint8_t sub)
{
    const size_t i = place(index, sub);
    return i < SB_N_RUNS && sb_runs[i].index == index && sb_runs[i].sub <= sub ? &sb_runs[i] : NULL;
}

static bool has_index(uint16_t index)
{
    const size_t i = place(index, 0);
    return i < SB_N_RUNS && sb_runs[i].index == index;
}

size_t sb_offset(const struct sb_run *run, uint8_t sub)
{
    return run->at + (size_t)(sub - run->sub) * sb_size(run->type);
}

uint32_t sb_get(const struct sb_board *b, uint16_t index, uint8_t sub)
{
    const struct sb_run *run = sb_find(index, sub);
    const unsigned n = run ? sb_size(run->type) : 0;
    return n ? sb_load(&b->image[sb_offset(run, sub)], n < 4 ? n : 4) : 0;
}

void sb_put(struct sb_board *b, uint16_t index, uint8_t sub, uint32_t value)
{
    const struct sb_run *run = sb_find(index, sub);
    if (run)
        sb_store(&b->image[sb_offset(run, sub)], value, sb_size(run->type));
}

bool sb_set(struct sb_board *b, uint16_t index, uint8_t sub, const uint8_t *data)
{
    const struct sb_run *run = sb_find(index, sub);
    if (!run || !sb_size(run->type))
        return false;
    memcpy(&b->image[sb_offset(run, sub)], data, sb_size(run->type));
    sb_changed(b, index, sub);
    return true;
}

static void put_default(struct sb_board *b, const struct sb_run *run)
{
    const unsigned n = run->n * sb_size(run->type);
    const struct sb_text *text = n ? NULL : &sb_texts[run->at];
    if (n)
        memcpy(&b->image[run->at], &sb_defaults[run->at], n);
    else if (text->slot) {
        b->text_length[text->slot] = text->length;
        if (text->length != SB_NOWHERE)
            memcpy(b->text[text->slot - 1], text->text, text->length);
    }
    if (run->access & SB_RELATIVE) /* a run of one number */
        sb_store(&b->image[run->at], sb_load(&b->image[run->at], n) + b->node_id, n);
}

/* Put defaults where the bus can write, all else is the device's own and stays. */
void sb_load_defaults(struct sb_board *b, bool is_all, bool is_application)
{
    for (size_t i = 0; i < SB_N_RUNS; i++) {
        const struct sb_run *run = &sb_runs[i];
        const bool is_communication = run->index < FIRST_APPLICATION;
        const bool is_ours = run->access & SB_WRITE || (is_communication && run->access & SB_RELATIVE);
        if (is_all || (is_ours && (is_communication || is_application)))
            put_default(b, run);
    }
}

bool sb_is_default(const struct sb_board *b, const struct sb_run *run)
{
    const size_t n = (size_t)run->n * sb_size(run->type);
    if (!n) {
        const struct sb_text *text = &sb_texts[run->at];
        return b->text_length[text->slot] == text->length &&
               (text->length == SB_NOWHERE || memcmp(b->text[text->slot - 1], text->text, text->length) == 0);
    }
    if (run->access & SB_RELATIVE)
        return sb_load(&b->image[run->at], 4) == sb_load(&sb_defaults[run->at], 4) + b->node_id;
    return memcmp(&b->image[run->at], &sb_defaults[run->at], n) == 0;
}

bool sb_is_parameter(const struct sb_run *run)
{
    return run->access & SB_WRITE && run->access & SB_READ && run->index != HISTORY && run->index != STORE &&
           run->index != RESTORE;
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

static bool is_verified(uint16_t index)
{
    static const uint16_t verified[] = {0x1005, 0x1006, 0x1007, 0x1014, 0x1016, 0x1017, 0x1019};
    for (size_t i = 0; i < sizeof verified / sizeof *verified; i++)
        if (verified[i] == index)
            return true;
    return index >= 0x1800 && index < 0x1C00;
}

/* What a master verifies at every boot: entries as in a concise DCF (0x2060). */
static uint32_t checksum(const struct sb_board *b)
{
    uint32_t crc = 0;
    for (size_t i = 0; i < SB_N_RUNS; i++) {
        const struct sb_run *run = &sb_runs[i];
        const unsigned n = sb_size(run->type);
        for (unsigned k = 0; is_verified(run->index) && sb_is_parameter(run) && k < run->n; k++) {
            uint8_t head[7];
            sb_store(head, run->index, 2);
            head[2] = (uint8_t)(run->sub + k);
            sb_store(&head[3], n, 4);
            crc = sb_crc(sb_crc(crc, head, sizeof head), &b->image[run->at + k * n], n);
        }
    }
    return crc;
}

uint32_t sb_read(struct sb_board *b, uint16_t index, uint8_t sub, uint8_t *value, const uint8_t **data, uint32_t *n)
{
    const struct sb_run *run = sb_find(index, sub);
    if (!run)
        return has_index(index) ? ABORT_NO_SUB_INDEX : ABORT_NO_OBJECT;
    if (!(run->access & SB_READ))
        return ABORT_WRITE_ONLY;
    *n = sb_size(run->type);
    *data = value;
    if (!*n) {
        const struct sb_text *text = &sb_texts[run->at];
        *data = text->slot ? b->text[text->slot - 1] : (const uint8_t *)text->text;
        *n = text->slot ? b->text_length[text->slot] : text->length;
        return *n == SB_NOWHERE ? ABORT_NO_DATA : 0;
    }
    if (index == SB_READINGS && sub)
        sb_sample(b);
    if (index == HISTORY && sub > sb_get(b, HISTORY, 0))
        return ABORT_NO_DATA; /* CiA 301, 7.5.2.4 */
    memcpy(value, &b->image[sb_offset(run, sub)], *n);
    if ((index == STORE || index == RESTORE) && sub)
        sb_store(value, b->flash_bytes != 0, *n);
    else if (index == SB_CHECKSUM)
        sb_store(value, checksum(b), *n);
    return 0;
}

uint32_t sb_admit(uint16_t index, uint8_t sub, uint32_t length)
{
    const struct sb_run *run = sb_find(index, sub);
    if (!run)
        return has_index(index) ? ABORT_NO_SUB_INDEX : ABORT_NO_OBJECT;
    if (!(run->access & SB_WRITE))
        return ABORT_READ_ONLY;
    if (length == SB_UNKNOWN_LENGTH)
        return 0;
    const unsigned size = sb_size(run->type);
    if (size && length != size)
        return length > size ? ABORT_LENGTH_HIGH : ABORT_LENGTH_LOW;
    return !size && length > SB_TEXT_ROOM ? ABORT_MEMORY : 0;
}

uint32_t sb_check(const struct sb_run *run, const uint8_t *data)
{
    const unsigned n = sb_size(run->type);
    if (run->type == 0x01 && data[0] > 1)
        return ABORT_VALUE;
    if ((run->type == 0x08 && (data[3] & 0x7F) == 0x7F && data[2] & 0x80) ||
        (run->type == 0x11 && (data[7] & 0x7F) == 0x7F && (data[6] & 0xF0) == 0xF0))
        return ABORT_VALUE; /* a real that is infinite or none */
    if (!run->limit)
        return 0;
    uint64_t bits = sb_load(data, n < 4 ? n : 4) | (n > 4 ? (uint64_t)sb_load(&data[4], n - 4) << 32 : 0);
    const bool is_signed = (run->type >= 0x02 && run->type <= 0x04) || (run->type >= 0x10 && run->type <= 0x15);
    if (is_signed && n < 8 && bits >> (8 * n - 1))
        bits |= UINT64_MAX << 8 * n;
    const int64_t value = !is_signed && bits > INT64_MAX ? INT64_MAX : (int64_t)bits;
    if (value > sb_limits[run->limit].high)
        return ABORT_VALUE_HIGH;
    return value < sb_limits[run->limit].low ? ABORT_VALUE_LOW : 0;
}

uint32_t sb_ask_host(struct sb_board *b, uint16_t index, uint8_t sub, const uint8_t *data)
{
    return b->on_write ? b->on_write(b, index, sub, data) : 0;
}

static void clear_marks(struct sb_board *b)
{
    sb_put(b, MARKS, 1, 0);
    sb_put(b, MARKS, 2, 0);
}

/* A manager reads 0x1020 to find whether it has to configure the board again (CiA 301, 7.5.2.24). */
static void mark(struct sb_board *b, const struct sb_run *run)
{
    if (run->index == MARKS)
        b->is_mark_old = false;
    else if (sb_is_parameter(run)) {
        b->is_mark_old |= run->index >= FIRST_APPLICATION;
        clear_marks(b);
    }
}

void sb_marks_loaded(struct sb_board *b, bool is_application)
{
    if (is_application)
        b->is_mark_old = false;
    else if (b->is_mark_old)
        clear_marks(b);
}

static uint32_t check_rules(struct sb_board *b, uint16_t index, uint8_t sub, uint32_t value)
{
    if (index >= 0x1400 && index < 0x1C00)
        return sb_pdo_check(b, index, sub, value);
    return sb_node_check(b, index, sub, value);
}

/* Take the data of a download; those of a text are in its room already. */
uint32_t sb_write(struct sb_board *b, uint16_t index, uint8_t sub, const uint8_t *data, uint32_t n)
{
    uint32_t code = sb_admit(index, sub, n);
    if (code)
        return code;
    const struct sb_run *run = sb_find(index, sub);
    if (!sb_size(run->type)) {
        if ((code = sb_ask_host(b, index, sub, data)) == 0) {
            b->text_length[sb_texts[run->at].slot] = (uint16_t)n;
            mark(b, run);
        }
        return code;
    }
    if ((code = sb_check(run, data)) != 0 ||
        (code = check_rules(b, index, sub, sb_load(data, n < 4 ? (unsigned)n : 4))) != 0 ||
        (code = sb_ask_host(b, index, sub, data)) != 0)
        return code;
    if (index == HISTORY) {
        sb_clear_history(b);
        return 0;
    }
    if (index == STORE || index == RESTORE)
        return sb_storage_command(b, index, sub, data);
    uint8_t *to = &b->image[sb_offset(run, sub)];
    const bool is_new = memcmp(to, data, n) != 0;
    memcpy(to, data, n);
    if (is_new)
        mark(b, run);
    sb_changed(b, index, sub);
    return 0;
}

void sb_changed(struct sb_board *b, uint16_t index, uint8_t sub)
{
    (void)sub;
    if (index >= 0x1400 && index < 0x1C00)
        sb_pdo_changed(b, index);
    else
        sb_node_changed(b, index);
}

/* Identifiers of other services (CiA 301, table 40). */
bool sb_is_restricted(uint32_t id)
{
    return id < 0x080 || (id > 0x100 && id < 0x181) || (id > 0x580 && id < 0x600) || (id > 0x600 && id < 0x680) ||
           (id >= 0x6E0 && id < 0x700) || (id > 0x700 && id < 0x800);
}
