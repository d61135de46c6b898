/* PDOs: TPDOs on SYNC, on events and on timers, RPDOs into the dictionary, and what may be mapped and when. */
#include <string.h>

#include "skin.h"

enum { COB_ID = 1, TYPE = 2, INHIBIT = 3, TIMER = 5, START = 6 };
enum { ACYCLIC = 0, SYNC_MOST = 240, EVENT = 254 };
enum { UPPER = 1, LOWER = 2, DELTA = 4 };
#define TO_MAPPING 0x200
#define WINDOW 0x1007

static bool is_cyclic(const struct sb_pdo *pdo)
{
    return pdo->type > ACYCLIC && pdo->type <= SYNC_MOST;
}

/* Whether a TPDO is sent when something asks for it. */
static bool has_events(const struct sb_board *b, const struct sb_pdo *pdo)
{
    return pdo->is_sent && pdo->valid && !is_cyclic(pdo) && b->state == SB_OPERATIONAL;
}

static bool is_reading(const struct sb_slot *slot)
{
    return slot->index == SB_READINGS && slot->sub;
}

/* --- Mapping (CiA 301, 7.5.2.36 and 7.5.2.38) ------------------------------------------------------ */

static uint32_t map_entry(struct sb_board *b, const struct sb_pdo *pdo, uint32_t value, struct sb_slot *slot)
{
    static const uint8_t dummies[] = {0, 1, 8, 16, 32, 8, 16, 32}; /* bits that are skipped, by type */
    const uint16_t index = (uint16_t)(value >> 16);
    const uint8_t sub = (uint8_t)(value >> 8), bits = (uint8_t)value;
    const struct sb_run *run = sb_find(index, sub);
    *slot = (struct sb_slot){sb_at(b, index, sub), index, sub, bits};
    if (!pdo->is_sent && index >= 1 && index < sizeof dummies && sub == 0)
        return bits == dummies[index] ? 0 : ABORT_NOT_MAPPABLE;
    if (!run)
        return ABORT_NO_OBJECT;
    if (!(run->access & (pdo->is_sent ? SB_MAP_TX : SB_MAP_RX)) || !bits)
        return ABORT_NOT_MAPPABLE;
    return bits == (run->access & SB_BOOLEAN ? 1 : 8 * run->size) ? 0 : ABORT_NOT_MAPPABLE;
}

/* Make the first n entries of its mapping the slots of a PDO, or return why they are none. */
static uint32_t map(struct sb_board *b, struct sb_pdo *pdo, uint32_t n)
{
    static const uint8_t lengths[] = {12, 16, 20, 24, 32, 48, 64}; /* those of CAN FD */
    const uint8_t *longer = lengths;
    const uint16_t mapping = (uint16_t)(pdo->index + TO_MAPPING);
    unsigned bits = 0;
    pdo->has_readings = false;
    if (n > SB_PDO_ENTRIES || (n && !sb_find(mapping, (uint8_t)n)))
        return ABORT_PDO_TOO_LONG;
    for (uint8_t i = 0; i < n; i++) {
        const uint32_t code = map_entry(b, pdo, sb_get(b, mapping, (uint8_t)(i + 1)), &pdo->slots[i]);
        if (code)
            return code;
        bits += pdo->slots[i].bits;
        pdo->has_readings |= is_reading(&pdo->slots[i]);
    }
    if (bits > 8u * SB_FRAME_BYTES)
        return ABORT_PDO_TOO_LONG;
    pdo->n_slots = (uint8_t)n;
    pdo->length = (uint8_t)((bits + 7) / 8);
    if (pdo->length > 8) {
        while (*longer < pdo->length)
            longer++;
        pdo->length = *longer;
    }
    return 0;
}

static void compile(struct sb_board *b, struct sb_pdo *pdo)
{
    const uint32_t cob_id = sb_get(b, pdo->index, COB_ID);
    pdo->length = pdo->n_slots = 0;
    pdo->valid = !(cob_id & (COB_INVALID | COB_EXTENDED)) &&
                 map(b, pdo, sb_get(b, (uint16_t)(pdo->index + TO_MAPPING), 0)) == 0 && pdo->n_slots;
    pdo->id = (uint16_t)(cob_id & 0x7FF);
    pdo->type = (uint8_t)sb_get(b, pdo->index, TYPE);
    pdo->inhibit = (uint16_t)sb_get(b, pdo->index, INHIBIT);
    pdo->timer = (uint16_t)sb_get(b, pdo->index, TIMER);
    pdo->start = (uint8_t)sb_get(b, pdo->index, START);
}

/* Return the PDO that a communication or mapping parameter is of, NULL for none. */
static struct sb_pdo *pdo_of(struct sb_board *b, uint16_t index)
{
    for (struct sb_pdo *pdo = b->pdos; pdo < b->pdos + SB_N_PDOS; pdo++)
        if (pdo->index == (index & ~TO_MAPPING))
            return pdo;
    return NULL;
}

uint32_t sb_pdo_check(struct sb_board *b, uint16_t index, uint8_t sub, uint32_t value)
{
    struct sb_pdo *pdo = pdo_of(b, index);
    const uint32_t old = pdo ? sb_get(b, pdo->index, COB_ID) : COB_INVALID;
    const bool is_valid = !(old & COB_INVALID);
    struct sb_slot slot;
    if (!pdo)
        return 0;
    if (index & TO_MAPPING) {
        if (is_valid || (sub && sb_get(b, index, 0)))
            return ABORT_ACCESS;
        return !sub ? map(b, pdo, value) : value ? map_entry(b, pdo, value, &slot) : 0;
    }
    if (sub == COB_ID)
        return pdo->is_sent && old & ~value & COB_NO_RTR ? ABORT_VALUE : sb_check_cob_id(value, old, COB_NO_RTR);
    if (sub == TYPE && value > SYNC_MOST && value < EVENT)
        return ABORT_VALUE; /* reserved, or in answer to remote frames */
    return (sub == INHIBIT || sub == START) && is_valid ? ABORT_ACCESS : 0;
}

/* Set bits of a PDO or of a value, whose bits are 0, from the other one. */
static void copy_bits(uint8_t *to, unsigned at, const uint8_t *from, unsigned from_at, unsigned n)
{
    if ((at | from_at | n) % 8 == 0)
        memcpy(&to[at / 8], &from[from_at / 8], n / 8);
    else
        for (; n--; at++, from_at++)
            to[at / 8] |= (uint8_t)((from[from_at / 8] >> from_at % 8 & 1) << at % 8);
}

/* --- Readings ------------------------------------------------------------------------------------- */

int32_t sb_reading(const struct sb_board *b, unsigned tactel)
{
    const uint8_t *at = &b->image[SB_READINGS_AT + SB_READING_BYTES * tactel];
    return SB_READING_BYTES == 1 ? (int8_t)*at : (int16_t)sb_load(at, 2);
}

/* Take a sample into the image. */
void sb_sample(struct sb_board *b)
{
    int16_t readings[SB_N_TACTELS];
    uint16_t age = 0;
    b->sample_status = sample(b, readings, &age);
    for (unsigned i = 0; i < SB_N_TACTELS; i++)
        sb_store(&b->image[SB_READINGS_AT + SB_READING_BYTES * i], (uint16_t)readings[i], SB_READING_BYTES);
    sb_put(b, SB_STAMP, 3, age);
}

/* Take a sample for PDOs and stamp it, where the board has room for it; counter 0: for no SYNC. */
static void sample_for_pdos(struct sb_board *b, uint8_t counter)
{
    sb_sample(b);
    sb_put(b, SB_STAMP, 1, b->sample_status & SB_OLD ? 0 : counter);
    sb_put(b, SB_STAMP, 2, b->sample_status | (sb_get(b, 0x1001, 0) ? 4u : 0));
}

/* Whether a reading is worth telling (CiA 401): by its limits, and by how far it is from what was told. */
static bool is_worth_telling(const struct sb_board *b, uint8_t sub)
{
    const uint32_t select = sb_get(b, 0x6421, sub), band = select & DELTA ? sb_get(b, 0x6426, sub) : 0;
    const int32_t value = sb_reading(b, sub - 1u), step = value - b->sent[sub - 1];
    if (b->is_sent_known[sub - 1] && (uint32_t)(step < 0 ? -step : step) <= band)
        return false;
    return (select && !(select & (UPPER | LOWER))) || (select & UPPER && value >= (int32_t)sb_get(b, 0x6424, sub)) ||
           (select & LOWER && value <= (int32_t)sb_get(b, 0x6425, sub));
}

/* Take a sample when it is time, for the guard and for events; ask for the TPDOs with a reading worth telling. */
uint64_t sb_scan_tick(struct sb_board *b)
{
    bool is_watching = false;
    for (struct sb_pdo *pdo = b->pdos; sb_get(b, 0x6423, 0) && pdo < b->pdos + SB_N_PDOS; pdo++)
        is_watching |= pdo->has_readings && has_events(b, pdo);
    if (!is_watching && !sb_guards(b)) {
        sb_guard_compare(b);
        b->sampled = b->now;
        return SB_NEVER;
    }
    if (b->now >= b->sampled + SB_PERIOD_US) {
        b->sampled = b->now;
        if (is_watching)
            sample_for_pdos(b, 0);
        else
            sb_sample(b);
        sb_guard_compare(b);
        for (struct sb_pdo *pdo = b->pdos; is_watching && pdo < b->pdos + SB_N_PDOS; pdo++)
            for (unsigned i = 0; has_events(b, pdo) && i < pdo->n_slots; i++)
                pdo->requested |= is_reading(&pdo->slots[i]) && is_worth_telling(b, pdo->slots[i].sub);
    }
    return SB_PERIOD_US ? b->sampled + SB_PERIOD_US : SB_NEVER;
}

/* --- TPDOs ---------------------------------------------------------------------------------------- */

static void start(struct sb_board *b, struct sb_pdo *pdo)
{
    pdo->countdown = pdo->type;
    pdo->awaits_start = pdo->start && sb_get(b, 0x1019, 0);
    pdo->requested = pdo->is_waiting = false;
    pdo->free = 0;
    pdo->due = pdo->is_sent ? sb_after(b, pdo->timer) : SB_NEVER;
}

static void send(struct sb_board *b, const struct sb_pdo *pdo)
{
    struct sb_frame frame = {.id = pdo->id, .length = pdo->length, .flags = pdo->length > 8 ? SB_FD : 0};
    unsigned bit = 0;
    frame.expires = pdo->type < EVENT && b->sync_closes != SB_NEVER;
    frame.t_us = (uint32_t)b->sync_closes;
    for (const struct sb_slot *slot = pdo->slots; slot < pdo->slots + pdo->n_slots; slot++) {
        copy_bits(frame.data, bit, slot->at, 0, slot->bits);
        bit += slot->bits;
        if (!is_cyclic(pdo) && is_reading(slot)) {
            b->sent[slot->sub - 1] = (int16_t)sb_reading(b, slot->sub - 1u);
            b->is_sent_known[slot->sub - 1] = true;
        }
    }
    can_send(b, &frame, false);
}

bool sb_request(struct sb_board *b, uint16_t index)
{
    bool is_any = false;
    for (struct sb_pdo *pdo = b->pdos; pdo < b->pdos + SB_N_PDOS; pdo++)
        for (unsigned i = 0; has_events(b, pdo) && i < pdo->n_slots; i++)
            if (pdo->index == index || pdo->slots[i].index == index)
                is_any = pdo->requested = true;
    return is_any;
}

/* Count one SYNC for a TPDO that is not sent with each; return whether it is sent with this one. */
static bool is_turn(struct sb_pdo *pdo, uint8_t counter)
{
    const bool is_requested = pdo->requested;
    pdo->requested = false;
    if (pdo->type == ACYCLIC)
        return is_requested;
    pdo->awaits_start = pdo->awaits_start && counter != pdo->start;
    if (pdo->awaits_start || --pdo->countdown)
        return false;
    pdo->countdown = pdo->type;
    return true;
}

static void send_synchronous(struct sb_board *b, uint8_t counter)
{
    const bool is_late = b->now > b->sync_closes;
    bool is_missed = false;
    if (!is_late)
        sb_report(b, ERROR_COMMUNICATION, WINDOW, false);
    for (unsigned pass = 0; pass < 2; pass++) /* those of every SYNC first */
        for (struct sb_pdo *pdo = b->pdos; pdo < b->pdos + SB_N_PDOS; pdo++) {
            const bool is_every = pdo->type == 1 && !pdo->start;
            if (!pdo->is_sent || !pdo->valid || pdo->type >= EVENT || is_every == (pass == 1))
                continue;
            is_missed = is_late;
            if ((is_every || is_turn(pdo, counter)) && !is_late)
                send(b, pdo);
        }
    if (is_missed) /* a late PDO would be taken for that of the next SYNC */
        sb_report(b, ERROR_COMMUNICATION, WINDOW, true);
}

/* --- RPDOs ---------------------------------------------------------------------------------------- */

/* Store all values of an RPDO, or none if one of them may not be. */
static void apply(struct sb_board *b, const struct sb_pdo *pdo, const uint8_t *from)
{
    for (unsigned pass = 0; pass < 3; pass++) {
        unsigned bit = 0;
        for (const struct sb_slot *slot = pdo->slots; slot < pdo->slots + pdo->n_slots; bit += slot++->bits) {
            uint8_t value[8] = {0};
            if (!slot->at)
                continue;
            copy_bits(value, 0, from, bit, slot->bits);
            if (pass == 2)
                sb_set(b, slot->index, slot->sub, value, sb_find(slot->index, slot->sub)->size);
            else if (pass ? b->on_write && b->on_write(b, slot->index, slot->sub, value)
                          : sb_check(sb_find(slot->index, slot->sub), value))
                return;
        }
    }
}

bool sb_rpdo_hears(const struct sb_board *b, uint16_t id)
{
    for (const struct sb_pdo *pdo = b->pdos; pdo < b->pdos + SB_N_RPDOS; pdo++)
        if (pdo->valid && pdo->id == id)
            return true;
    return false;
}

void sb_rpdo_receive(struct sb_board *b, const struct sb_frame *frame)
{
    for (struct sb_pdo *pdo = b->pdos; pdo < b->pdos + SB_N_RPDOS; pdo++) {
        if (!pdo->valid || pdo->id != frame->id)
            continue;
        sb_report(b, ERROR_PDO_LENGTH, pdo->id, frame->length < pdo->length);
        if (frame->length < pdo->length)
            continue;
        /* the bytes that are mapped count (CiA 301, 7.2.2.2) */
        sb_report(b, ERROR_PDO_TOO_LONG, pdo->id, frame->length > pdo->length);
        sb_report(b, ERROR_RPDO_TIMEOUT, pdo->id, false);
        pdo->due = sb_after(b, pdo->timer);
        if (pdo->type > SYNC_MOST)
            apply(b, pdo, frame->data);
        else if (b->now <= b->sync_closes) {
            pdo->is_waiting = true;
            memcpy(pdo->data, frame->data, sizeof pdo->data);
        }
    }
}

/* --- All of them ---------------------------------------------------------------------------------- */

void sb_pdo_sync(struct sb_board *b, uint8_t counter)
{
    for (struct sb_pdo *pdo = b->pdos; pdo < b->pdos + SB_N_PDOS; pdo++)
        if (pdo->is_waiting) {
            pdo->is_waiting = false;
            apply(b, pdo, pdo->data);
        }
    sample_for_pdos(b, counter);
    if (b->state == SB_OPERATIONAL)
        send_synchronous(b, counter);
}

void sb_pdo_configure(struct sb_board *b)
{
    for (unsigned k = 0; k < SB_N_PDOS; k++) {
        b->pdos[k].index = sb_pdos[k];
        b->pdos[k].is_sent = sb_pdos[k] >= 0x1800;
        compile(b, &b->pdos[k]);
    }
}

/* PDOs begin anew, and all readings are news again, with every entry to OPERATIONAL. */
void sb_pdo_enter(struct sb_board *b)
{
    for (unsigned k = 0; k < SB_N_PDOS; k++)
        start(b, &b->pdos[k]);
    memset(b->is_sent_known, 0, sizeof b->is_sent_known);
    /* The guard is armed by no sample from before, and says so: a reset does not go unnoticed. */
    if (sb_guards(b))
        b->sampled = b->now;
    else
        sb_guard_compare(b);
    sb_request(b, SB_GUARD);
}

void sb_pdo_changed(struct sb_board *b, uint16_t index)
{
    struct sb_pdo *pdo = pdo_of(b, index);
    if (!pdo)
        return;
    const bool was_valid = pdo->valid;
    const uint16_t id = pdo->id, type = pdo->type, timer = pdo->timer;
    compile(b, pdo);
    if (pdo->is_sent && (!was_valid || type != pdo->type || timer != pdo->timer))
        start(b, pdo);
    if (pdo->is_sent)
        return;
    pdo->is_waiting = false;
    if (!pdo->valid || !pdo->timer) {
        pdo->due = SB_NEVER;
        sb_report(b, ERROR_RPDO_TIMEOUT, id, false);
    }
    if (!pdo->valid) { /* nothing will come that could end them */
        sb_report(b, ERROR_PDO_LENGTH, id, false);
        sb_report(b, ERROR_PDO_TOO_LONG, id, false);
    }
}

/* Send the TPDOs that are due, and report the RPDOs that are. */
uint64_t sb_pdo_tick(struct sb_board *b)
{
    bool is_sampled = false;
    uint64_t wake = SB_NEVER;
    for (struct sb_pdo *pdo = b->pdos; pdo < b->pdos + SB_N_PDOS; pdo++) {
        if (pdo->is_sent && !(has_events(b, pdo) && pdo->type >= EVENT))
            continue;
        if ((pdo->requested || b->now >= pdo->due) && b->now >= pdo->free) {
            pdo->requested = false;
            pdo->free = b->now + 100u * pdo->inhibit;
            pdo->due = pdo->is_sent ? sb_after(b, pdo->timer) : SB_NEVER;
            if (!pdo->is_sent)
                sb_report(b, ERROR_RPDO_TIMEOUT, pdo->id, true);
            else {
                if (pdo->has_readings && !is_sampled)
                    sample_for_pdos(b, 0); /* PDOs carry the values of the moment */
                is_sampled |= pdo->has_readings;
                send(b, pdo);
            }
        }
        wake = sb_earlier(wake, pdo->requested || pdo->due < pdo->free ? pdo->free : pdo->due);
    }
    return wake;
}
