/* PDOs: TPDOs on SYNC, on events and on timers, RPDOs into the dictionary, and what may be mapped and when. */
#include <string.h>

#include "skin.h"

enum { COB_ID = 1, TYPE = 2, INHIBIT = 3, TIMER = 5, START = 6 };
enum { ACYCLIC = 0, SYNC_MOST = 240, EVENT = 254 };
enum { UPPER = 1, LOWER = 2, DELTA = 4 };
#define RPDO 0x1400
#define TPDO 0x1800
#define TO_MAPPING 0x200
static const uint8_t window_tag[5] = {0x07, 0x10}; /* EMCY data: 0x1007 */

static bool is_on_event(const struct sb_pdo *pdo)
{
    return pdo->type >= EVENT;
}

static bool is_cyclic(const struct sb_pdo *pdo)
{
    return pdo->type > ACYCLIC && pdo->type <= SYNC_MOST;
}

static bool is_in_window(const struct sb_board *b)
{
    return b->now <= b->sync_closes;
}

/* --- Mapping (CiA 301, 7.5.2.36 and 7.5.2.38) ------------------------------------------------------ */

static unsigned bits_of(uint8_t type)
{
    return type == 0x01 ? 1 : 8 * sb_size(type);
}

static uint32_t map_entry(uint32_t value, bool is_tpdo, struct sb_slot *slot)
{
    const uint16_t index = (uint16_t)(value >> 16);
    const uint8_t sub = (uint8_t)(value >> 8), bits = (uint8_t)value;
    slot->bits = bits;
    slot->at = SB_NOWHERE;
    if (!is_tpdo && index >= 1 && index <= 7 && sub == 0) /* a dummy skips its length */
        return bits == bits_of((uint8_t)index) ? 0 : ABORT_NOT_MAPPABLE;
    const struct sb_run *run = sb_find(index, sub);
    if (!run)
        return ABORT_NO_OBJECT;
    if (!(run->access & (is_tpdo ? SB_MAP_TX : SB_MAP_RX)) || !bits || bits != bits_of(run->type))
        return ABORT_NOT_MAPPABLE;
    slot->at = (uint16_t)sb_offset(run, sub);
    return 0;
}

/* Whether the first n entries of a mapping make a PDO; they are left in its slots. */
static uint32_t map_all(const struct sb_board *b, uint16_t mapping, uint32_t n, bool is_tpdo, struct sb_pdo *pdo)
{
    unsigned bits = 0;
    if (n > SB_PDO_ENTRIES || (n && !sb_find(mapping, (uint8_t)n)))
        return ABORT_PDO_TOO_LONG;
    for (uint8_t i = 0; i < n; i++) {
        struct sb_slot slot;
        const uint32_t code = map_entry(sb_get(b, mapping, (uint8_t)(i + 1)), is_tpdo, &slot);
        if (code)
            return code;
        bits += slot.bits;
        if (pdo)
            pdo->slots[i] = slot;
    }
    if (bits > 8u * SB_FRAME_BYTES)
        return ABORT_PDO_TOO_LONG;
    if (pdo) {
        static const uint8_t lengths[] = {8, 12, 16, 20, 24, 32, 48, 64}; /* those of CAN FD */
        const unsigned length = (bits + 7) / 8;
        unsigned i = 0;
        while (lengths[i] < length)
            i++;
        pdo->length = length <= 8 ? (uint8_t)length : lengths[i];
        pdo->n_slots = (uint8_t)n;
    }
    return 0;
}

static void compile(struct sb_board *b, struct sb_pdo *pdo, uint16_t index, bool is_tpdo)
{
    const uint16_t mapping = (uint16_t)(index + TO_MAPPING);
    const uint32_t cob_id = sb_get(b, index, COB_ID);
    pdo->length = pdo->n_slots = 0;
    pdo->valid = !(cob_id & (COB_INVALID | COB_EXTENDED)) && sb_find(index, COB_ID) &&
                 map_all(b, mapping, sb_get(b, mapping, 0), is_tpdo, pdo) == 0 && pdo->n_slots;
    pdo->id = (uint16_t)(cob_id & 0x7FF);
    pdo->type = (uint8_t)sb_get(b, index, TYPE);
    pdo->inhibit = (uint16_t)sb_get(b, index, INHIBIT);
    pdo->timer = (uint16_t)sb_get(b, index, TIMER);
    pdo->start = (uint8_t)sb_get(b, index, START);
}

static uint32_t check_cob_id(uint32_t value, uint32_t old, uint32_t delivered, bool is_tpdo)
{
    if (value & ~(COB_INVALID | COB_NO_RTR | 0x7FFu) || (is_tpdo && delivered & ~value & COB_NO_RTR))
        return ABORT_VALUE;
    if (value & COB_INVALID)
        return 0;
    return (!(old & COB_INVALID) && (old ^ value) & 0x7FF) || sb_is_restricted(value & 0x7FF) ? ABORT_VALUE : 0;
}

uint32_t sb_pdo_check(struct sb_board *b, uint16_t index, uint8_t sub, uint32_t value)
{
    const bool is_tpdo = index >= TPDO, is_mapping = index & TO_MAPPING;
    const uint16_t communication = (uint16_t)(index & ~TO_MAPPING);
    const uint32_t old = sb_find(communication, COB_ID) ? sb_get(b, communication, COB_ID) : COB_INVALID;
    const bool is_valid = !(old & COB_INVALID);
    struct sb_slot slot;
    if (!is_mapping) {
        if (sub == COB_ID)
            return check_cob_id(value, old, sb_load(&sb_defaults[sb_offset(sb_find(index, sub), sub)], 4), is_tpdo);
        if (sub == TYPE && value > SYNC_MOST && value < EVENT)
            return ABORT_VALUE; /* reserved, or in answer to remote frames */
        return (sub == INHIBIT || sub == START) && is_valid ? ABORT_ACCESS : 0;
    }
    if (is_valid || (sub && sb_get(b, index, 0)))
        return ABORT_ACCESS;
    if (sub == 0)
        return map_all(b, index, value, is_tpdo, NULL);
    return value ? map_entry(value, is_tpdo, &slot) : 0;
}

/* --- Readings ------------------------------------------------------------------------------------- */

static int16_t reading(const struct sb_board *b, unsigned i)
{
    return SB_READING_BYTES == 1 ? (int8_t)b->image[SB_READINGS_AT + i]
                                 : (int16_t)sb_load(&b->image[SB_READINGS_AT + 2 * i], 2);
}

/* Take a sample into the image. */
void sb_sample(struct sb_board *b)
{
    int16_t readings[SB_N_TACTELS];
    uint16_t age = 0;
    b->sample_status = sample(b, readings, &age);
    for (unsigned i = 0; i < SB_N_TACTELS; i++)
        sb_store(&b->image[SB_READINGS_AT + SB_READING_BYTES * i], (uint16_t)readings[i], SB_READING_BYTES);
    if (SB_AGE_AT != SB_NOWHERE)
        sb_store(&b->image[SB_AGE_AT % SB_IMAGE], age, 2);
}

/* Stamp the sample of a SYNC, where the board has room for it; counter 0: for no SYNC. */
static void stamp(struct sb_board *b, uint8_t counter)
{
    if (SB_STAMP_AT == SB_NOWHERE)
        return;
    b->image[SB_STAMP_AT % SB_IMAGE] = b->sample_status & SB_OLD ? 0 : counter;
    b->image[(SB_STAMP_AT + 1) % SB_IMAGE] = (uint8_t)(b->sample_status | (sb_get(b, 0x1001, 0) ? 4 : 0));
}

static int64_t column(const struct sb_board *b, uint16_t index, unsigned i)
{
    const uint32_t value = sb_get(b, index, (uint8_t)(i + 1));
    return index == 0x6424 || index == 0x6425 ? (int32_t)value : (int64_t)value;
}

/* Whether a reading is worth telling (CiA 401): by its limits, and by how far it is from what was told. */
static bool is_worth_telling(const struct sb_board *b, unsigned i)
{
    const uint32_t select = sb_get(b, 0x6421, (uint8_t)(i + 1));
    const int64_t value = reading(b, i), step = value - b->sent[i];
    const int64_t band = select & DELTA ? column(b, 0x6426, i) : 0;
    if (b->is_sent_known[i] && (step < 0 ? -step : step) <= band)
        return false;
    return (select && !(select & (UPPER | LOWER))) || (select & UPPER && value >= column(b, 0x6424, i)) ||
           (select & LOWER && value <= column(b, 0x6425, i));
}

/* Return which reading a slot carries, SB_N_TACTELS for none. */
static unsigned reading_in(const struct sb_slot *slot)
{
    const unsigned i = (slot->at - (unsigned)SB_READINGS_AT) / SB_READING_BYTES;
    return slot->at >= SB_READINGS_AT && i < SB_N_TACTELS ? i : SB_N_TACTELS;
}

static bool is_watching(const struct sb_board *b)
{
    if (b->state != SB_OPERATIONAL || !sb_get(b, 0x6423, 0))
        return false;
    for (unsigned k = 0; k < SB_TPDO_ROOM; k++)
        for (unsigned i = 0; b->tpdos[k].valid && !is_cyclic(&b->tpdos[k]) && i < b->tpdos[k].n_slots; i++)
            if (reading_in(&b->tpdos[k].slots[i]) < SB_N_TACTELS)
                return true;
    return false;
}

static void sample_for_events(struct sb_board *b)
{
    b->sampled = b->now;
    sb_sample(b);
    stamp(b, 0);
}

/* Ask for every TPDO with a reading worth telling. */
void sb_events(struct sb_board *b)
{
    if (!is_watching(b) || b->now < b->sampled + SB_SAMPLE_US)
        return;
    sample_for_events(b);
    for (unsigned k = 0; k < SB_TPDO_ROOM; k++)
        for (unsigned i = 0; i < b->tpdos[k].n_slots; i++) {
            const unsigned tactel = reading_in(&b->tpdos[k].slots[i]);
            if (tactel < SB_N_TACTELS && !is_cyclic(&b->tpdos[k]) && is_worth_telling(b, tactel))
                sb_request(b, k);
        }
}

/* --- TPDOs ---------------------------------------------------------------------------------------- */

static void start(struct sb_board *b, struct sb_pdo *pdo)
{
    pdo->countdown = pdo->type;
    pdo->awaits_start = pdo->start && sb_get(b, 0x1019, 0);
    pdo->requested = false;
    pdo->free = 0;
    pdo->due = pdo->timer ? b->now + 1000u * pdo->timer : SB_NEVER;
}

static void send(struct sb_board *b, struct sb_pdo *pdo)
{
    struct sb_frame frame;
    unsigned bit = 0;
    memset(&frame, 0, sizeof frame);
    frame.id = pdo->id;
    frame.length = pdo->length;
    frame.flags = pdo->length > 8 ? SB_FD : 0;
    frame.expires = !is_on_event(pdo) && b->sync_closes != SB_NEVER;
    frame.t_us = (uint32_t)b->sync_closes;
    for (unsigned i = 0; i < pdo->n_slots; i++) {
        const struct sb_slot *slot = &pdo->slots[i];
        for (unsigned k = 0; k < slot->bits;) {
            const unsigned to = bit + k, n = (slot->bits - k) >= 8 && to % 8 == 0 ? 8 : 1;
            const uint8_t value = (uint8_t)(b->image[slot->at + k / 8] >> k % 8);
            frame.data[to / 8] |= (uint8_t)(n == 8 ? value : (value & 1) << to % 8);
            k += n;
        }
        bit += slot->bits;
    }
    can_send(b, &frame, false);
    for (unsigned i = 0; !is_cyclic(pdo) && i < pdo->n_slots; i++) {
        const unsigned tactel = reading_in(&pdo->slots[i]);
        if (tactel < SB_N_TACTELS) {
            b->sent[tactel] = reading(b, tactel);
            b->is_sent_known[tactel] = true;
        }
    }
}

bool sb_request(struct sb_board *b, unsigned k)
{
    struct sb_pdo *pdo = &b->tpdos[k];
    if (k >= SB_TPDO_ROOM || !pdo->valid || is_cyclic(pdo) || b->state != SB_OPERATIONAL)
        return false;
    pdo->requested = true;
    return true;
}

/* Count one SYNC for a TPDO that is not sent with each; return whether it is sent with this one. */
static bool is_turn(struct sb_pdo *pdo, uint8_t counter)
{
    if (pdo->type == ACYCLIC) {
        const bool is_requested = pdo->requested;
        pdo->requested = false;
        return is_requested;
    }
    pdo->awaits_start = pdo->awaits_start && counter != pdo->start;
    if (pdo->awaits_start || --pdo->countdown)
        return false;
    pdo->countdown = pdo->type;
    return true;
}

static void send_synchronous(struct sb_board *b, uint8_t counter)
{
    const bool is_late = !is_in_window(b);
    bool is_missed = false;
    if (!is_late && b->is_window_missed) {
        b->is_window_missed = false;
        sb_error_end(b, ERROR_COMMUNICATION, window_tag);
    }
    /* those of every SYNC first */
    for (unsigned pass = 0; pass < 2; pass++)
        for (unsigned k = 0; k < SB_TPDO_ROOM; k++) {
            struct sb_pdo *pdo = &b->tpdos[k];
            const bool is_every = pdo->type == 1 && !pdo->start;
            if (!pdo->valid || is_on_event(pdo) || is_every == (pass == 1))
                continue;
            is_missed = is_late;
            if ((is_every || is_turn(pdo, counter)) && !is_late)
                send(b, pdo);
        }
    if (is_missed) { /* a late PDO would be taken for that of the next SYNC */
        b->is_window_missed = true;
        sb_error(b, ERROR_COMMUNICATION, 0, window_tag);
    }
}

void sb_tpdo_tick(struct sb_board *b)
{
    bool is_sampled = false;
    for (unsigned k = 0; b->state == SB_OPERATIONAL && k < SB_TPDO_ROOM; k++) {
        struct sb_pdo *pdo = &b->tpdos[k];
        if (pdo->valid && is_on_event(pdo) && (pdo->requested || b->now >= pdo->due) && b->now >= pdo->free) {
            pdo->requested = false;
            pdo->free = b->now + 100u * pdo->inhibit;
            pdo->due = pdo->timer ? b->now + 1000u * pdo->timer : SB_NEVER;
            if (!is_sampled)
                sample_for_events(b); /* PDOs carry the values of the moment */
            is_sampled = true;
            send(b, pdo);
        }
    }
}

/* --- RPDOs ---------------------------------------------------------------------------------------- */

/* An error of an RPDO came or went; its identifier is in the data of the EMCY. */
static void set_error(struct sb_board *b, uint16_t id, uint16_t code, bool is_there)
{
    const uint8_t data[5] = {(uint8_t)id, (uint8_t)(id >> 8)};
    if (is_there)
        sb_error(b, code, 0, data);
    else
        sb_error_end(b, code, data);
}

/* Store all values of an RPDO, or none if one of them may not be. */
static void apply(struct sb_board *b, unsigned k, const uint8_t *from)
{
    const uint16_t mapping = (uint16_t)(RPDO + TO_MAPPING + sb_rpdos[k]);
    const unsigned n_slots = b->rpdos[k].n_slots;
    for (unsigned pass = 0; pass < 3; pass++) {
        unsigned bit = 0;
        for (uint8_t i = 0; i < n_slots; i++) {
            const struct sb_slot slot = b->rpdos[k].slots[i];
            const uint32_t entry = sb_get(b, mapping, (uint8_t)(i + 1));
            const uint16_t index = (uint16_t)(entry >> 16);
            const uint8_t sub = (uint8_t)(entry >> 8);
            uint8_t value[8] = {0};
            for (unsigned to = 0; to < slot.bits && to < 64; to++)
                value[to / 8] |= (uint8_t)((from[(bit + to) / 8] >> (bit + to) % 8 & 1) << to % 8);
            bit += slot.bits;
            if (slot.at == SB_NOWHERE)
                continue;
            if (pass == 2)
                sb_set(b, index, sub, value);
            else if (pass ? sb_ask_host(b, index, sub, value) : sb_check(sb_find(index, sub), value)) {
                b->dropped++;
                return;
            }
        }
    }
}

bool sb_rpdo_hears(const struct sb_board *b, uint16_t id)
{
    for (unsigned k = 0; k < SB_RPDO_ROOM; k++)
        if (b->rpdos[k].valid && b->rpdos[k].id == id)
            return true;
    return false;
}

void sb_rpdo_receive(struct sb_board *b, const struct sb_frame *frame)
{
    for (unsigned k = 0; k < SB_RPDO_ROOM; k++) {
        struct sb_pdo *pdo = &b->rpdos[k];
        if (!pdo->valid || pdo->id != frame->id)
            continue;
        set_error(b, pdo->id, ERROR_PDO_LENGTH, frame->length < pdo->length);
        if (frame->length < pdo->length) {
            b->dropped++;
            continue;
        }
        /* the bytes that are mapped count (CiA 301, 7.2.2.2) */
        set_error(b, pdo->id, ERROR_PDO_TOO_LONG, frame->length > pdo->length);
        if (pdo->timer) {
            set_error(b, pdo->id, ERROR_RPDO_TIMEOUT, false);
            pdo->due = b->now + 1000u * pdo->timer;
        }
        if (pdo->type > SYNC_MOST)
            apply(b, k, frame->data);
        else if (is_in_window(b)) {
            pdo->is_waiting = true;
            memcpy(pdo->data, frame->data, sizeof pdo->data);
        } else
            b->dropped++;
    }
}

void sb_rpdo_tick(struct sb_board *b)
{
    for (unsigned k = 0; k < SB_RPDO_ROOM; k++)
        if (b->now >= b->rpdos[k].due) {
            b->rpdos[k].due = SB_NEVER;
            set_error(b, b->rpdos[k].id, ERROR_RPDO_TIMEOUT, true);
        }
}

/* --- All of them ---------------------------------------------------------------------------------- */

void sb_pdo_sync(struct sb_board *b, uint8_t counter)
{
    for (unsigned k = 0; k < SB_RPDO_ROOM; k++)
        if (b->rpdos[k].is_waiting) {
            b->rpdos[k].is_waiting = false;
            apply(b, k, b->rpdos[k].data);
        }
    sb_sample(b);
    stamp(b, counter);
    if (b->state == SB_OPERATIONAL)
        send_synchronous(b, counter);
}

void sb_pdo_configure(struct sb_board *b)
{
    for (unsigned k = 0; k < SB_TPDO_ROOM; k++)
        compile(b, &b->tpdos[k], (uint16_t)(TPDO + sb_tpdos[k]), true);
    for (unsigned k = 0; k < SB_RPDO_ROOM; k++) {
        compile(b, &b->rpdos[k], (uint16_t)(RPDO + sb_rpdos[k]), false);
        b->rpdos[k].due = SB_NEVER;
    }
}

/* PDOs begin anew, and all readings are news again, with every entry to OPERATIONAL. */
void sb_pdo_enter(struct sb_board *b)
{
    for (unsigned k = 0; k < SB_RPDO_ROOM; k++) {
        b->rpdos[k].is_waiting = false;
        b->rpdos[k].due = SB_NEVER;
    }
    for (unsigned k = 0; k < SB_TPDO_ROOM; k++)
        start(b, &b->tpdos[k]);
    memset(b->is_sent_known, 0, sizeof b->is_sent_known);
}

static void rpdo_changed(struct sb_board *b, struct sb_pdo *pdo, uint16_t index)
{
    const uint16_t id = pdo->id;
    const bool was_valid = pdo->valid;
    compile(b, pdo, index, false);
    pdo->is_waiting = false;
    if (!pdo->valid || !pdo->timer) {
        pdo->due = SB_NEVER;
        set_error(b, id, ERROR_RPDO_TIMEOUT, false);
    }
    if (was_valid && !pdo->valid) { /* nothing will come that could end them */
        set_error(b, id, ERROR_PDO_LENGTH, false);
        set_error(b, id, ERROR_PDO_TOO_LONG, false);
    }
}

void sb_pdo_changed(struct sb_board *b, uint16_t index)
{
    const uint16_t communication = (uint16_t)(index & ~TO_MAPPING);
    for (unsigned k = 0; k < SB_RPDO_ROOM; k++)
        if (communication == RPDO + sb_rpdos[k])
            rpdo_changed(b, &b->rpdos[k], communication);
    for (unsigned k = 0; k < SB_TPDO_ROOM; k++)
        if (communication == TPDO + sb_tpdos[k]) {
            struct sb_pdo *pdo = &b->tpdos[k];
            const bool was_valid = pdo->valid;
            const unsigned type = pdo->type, timer = pdo->timer;
            compile(b, pdo, communication, true);
            if (!was_valid || type != pdo->type || timer != pdo->timer)
                start(b, pdo);
        }
}

uint64_t sb_pdo_wake(const struct sb_board *b)
{
    uint64_t wake = is_watching(b) && SB_SAMPLE_US ? b->sampled + SB_SAMPLE_US : SB_NEVER;
    for (unsigned k = 0; k < SB_RPDO_ROOM; k++)
        wake = b->rpdos[k].due < wake ? b->rpdos[k].due : wake;
    for (unsigned k = 0; b->state == SB_OPERATIONAL && k < SB_TPDO_ROOM; k++) {
        const struct sb_pdo *pdo = &b->tpdos[k];
        const uint64_t due = pdo->requested || pdo->due < pdo->free ? pdo->free : pdo->due;
        if (pdo->valid && is_on_event(pdo) && due < wake)
            wake = due;
    }
    return wake;
}
