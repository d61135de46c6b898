/* The guard: a sample beyond the limits of 0x2081 sends the global fail-safe command at once. Not certified. */
#include "skin.h"

enum { ARMED = 1, TRIPPED = 2 };
enum { STATE = 1, TRIPPED_BY = 2, PERIOD = 4 };
enum { NEEDED = 0, OF = 1, SUM = 2, LIMITS = 6, WEIGHTS = LIMITS + 2 * SB_N_TACTELS };
enum { RESTS = WEIGHTS + 2 * SB_N_TACTELS, CRC = SB_GUARD_ROOM - 2 };
#define ACKNOWLEDGE 0x6E6B6361u
#define NO_LIMIT 0x7FFF
#define MAX_WEIGHT 511u /* so that the sum fits 32 bits */
#define MAX_SAMPLES 8
#define MAX_AGE 3u /* periods: a sample that is late or lost does not stop a robot */

static const uint8_t *limits_of(struct sb_board *b)
{
    const uint8_t *text = sb_at(b, SB_GUARD_LIMITS, 0);
    return text && sb_load(text, 2) == CRC + 2 ? text + 2 : NULL;
}

bool sb_guards(struct sb_board *b)
{
    return limits_of(b) && b->state == SB_OPERATIONAL;
}

/* Return why limits cannot be taken, 0 if they can; an empty text takes the guard away. */
uint32_t sb_guard_check(uint16_t index, const uint8_t *data, uint32_t n)
{
    uint32_t crc = 0;
    if (index != SB_GUARD_LIMITS || !n)
        return 0;
    if (n != CRC + 2 || !data[NEEDED] || data[NEEDED] > data[OF] || data[OF] > MAX_SAMPLES)
        return ABORT_VALUE;
    for (unsigned bit = 0; bit < 8 * CRC; bit++) {
        crc ^= bit % 8 ? 0 : (uint32_t)data[bit / 8] << 8;
        crc = crc << 1 ^ (crc & 0x8000 ? 0x11021 : 0);
    }
    for (const uint8_t *weight = &data[WEIGHTS]; weight < &data[RESTS]; weight += 2)
        if (sb_load(weight, 2) > MAX_WEIGHT)
            return ABORT_VALUE;
    return crc == sb_load(&data[CRC], 2) ? 0 : ABORT_VALUE;
}

/* New limits count at once: for a sample that takes the place of the newest one. */
void sb_guard_changed(struct sb_board *b, uint16_t index)
{
    if (index == SB_GUARD_LIMITS && sb_get(b, SB_GUARD, STATE) & ARMED) {
        b->beyond >>= 1;
        b->sampled = 0;
    }
}

static void say(struct sb_board *b, uint32_t state, uint32_t tripped_by)
{
    if (state == sb_get(b, SB_GUARD, STATE) && tripped_by == sb_get(b, SB_GUARD, TRIPPED_BY))
        return;
    sb_put(b, SB_GUARD, STATE, state);
    sb_put(b, SB_GUARD, TRIPPED_BY, tripped_by);
    sb_request(b, SB_GUARD);
}

uint32_t sb_guard_acknowledge(struct sb_board *b, uint32_t word)
{
    const uint32_t state = sb_get(b, SB_GUARD, STATE);
    if (word != ACKNOWLEDGE)
        return ABORT_VALUE;
    if (state & TRIPPED) {
        b->beyond = 0;
        sb_error_end(b, ERROR_GUARD, NULL);
        say(b, state & ARMED, 0);
    }
    return 0;
}

/* Compare the sample in the image, if it is guarded, and say what has changed. */
void sb_guard_compare(struct sb_board *b)
{
    const uint8_t *limits = limits_of(b), *healthy = sb_at(b, SB_HEALTHY, 0);
    const uint32_t was = sb_get(b, SB_GUARD, STATE), age_us = 100 * sb_get(b, SB_STAMP, 3);
    bool is_armed = sb_guards(b) && !b->sample_status && age_us <= MAX_AGE * sb_get(b, SB_GUARD, PERIOD);
    int32_t sum = 0, value = 0;
    unsigned n = 0;
    uint8_t who[5] = {0};
    for (unsigned i = SB_N_TACTELS; is_armed && i--;) {
        const int32_t reading = sb_reading(b, i), limit = (int16_t)sb_load(&limits[LIMITS + 2 * i], 2);
        const int32_t weight = (int32_t)sb_load(&limits[WEIGHTS + 2 * i], 2);
        is_armed = healthy[i / 8] >> i % 8 & 1 || (!weight && limit == NO_LIMIT);
        const int32_t above = reading - (int16_t)sb_load(&limits[RESTS + 2 * i], 2);
        sum += above > 0 ? weight * above : 0; /* a tactel that reads too little hides no force on others */
        if (reading > limit) {
            who[0] = (uint8_t)(i + 1);
            value = reading;
        }
    }
    if (is_armed)
        b->beyond = (uint8_t)(b->beyond << 1 | (who[0] || sum > (int32_t)sb_load(&limits[SUM], 4)));
    else
        b->beyond = 0;
    for (unsigned k = 0; is_armed && k < limits[OF]; k++)
        n += b->beyond >> k & 1;
    const bool is_trip = !(was & TRIPPED) && b->beyond & 1 && n >= limits[NEEDED];
    b->is_stop_due = (b->is_stop_due || is_trip) && !sb_send(b, SB_GFC, who, 0, true);
    if (is_trip) {
        sb_store(&who[1], (uint32_t)(who[0] ? value : sum), 4);
        sb_error(b, ERROR_GUARD, 0, who);
        sb_emcy_tick(b);
    }
    const uint32_t tripped_by = is_trip ? who[0] : sb_get(b, SB_GUARD, TRIPPED_BY);
    say(b, (was & TRIPPED) | (is_trip ? TRIPPED : 0) | is_armed, tripped_by);
}
