/* NMT, error control, EMCY and SYNC of one board; which service a frame is for, and when to be called again. */
#include <string.h>

#include "skin.h"

#define EMCY_RETRY_US 50000u /* ten waiting frames take 11 ms at 125 kbit/s */
#define RETRY_US 1000u

static bool has_emcy(uint8_t state)
{
    return state == SB_PRE_OPERATIONAL || state == SB_OPERATIONAL;
}

static bool is_running(const struct sb_board *b)
{
    return b->state != SB_INITIALISING;
}

bool sb_send(struct sb_board *b, uint32_t id, const uint8_t *data, uint8_t n, bool urgent)
{
    struct sb_frame frame;
    memset(&frame, 0, sizeof frame);
    frame.id = (uint16_t)(id & 0x7FF);
    frame.length = n;
    memcpy(frame.data, data, n);
    return can_send(b, &frame, urgent);
}

/* --- EMCY, error register and history (CiA 301, 7.2.7) -------------------------------------------- */

static uint64_t emcy_wake(const struct sb_board *b)
{
    return b->n_waiting && has_emcy(b->state) ? b->emcy_free : SB_NEVER;
}

static void emcy_tick(struct sb_board *b)
{
    while (b->n_waiting && has_emcy(b->state) && b->now >= b->emcy_free) {
        const uint32_t id = sb_get(b, 0x1014, 0);
        if (!(id & COB_INVALID)) {
            if (!sb_send(b, id, b->waiting[0], 8, true)) {
                b->emcy_free = b->now + EMCY_RETRY_US;
                return;
            }
            b->emcy_free = b->now + 100u * sb_get(b, 0x1015, 0);
        }
        memmove(b->waiting[0], b->waiting[1], 8u * --b->n_waiting);
    }
}

static void emcy_queue(struct sb_board *b, uint16_t code, const uint8_t data[5])
{
    uint8_t bits = 0;
    for (unsigned i = 0; i < b->n_errors; i++)
        bits |= b->errors[i].bits;
    sb_put(b, 0x1001, 0, bits);
    if (b->n_waiting == SB_ERRORS) /* the oldest is lost; the history still has its error */
        memmove(b->waiting[0], b->waiting[1], 8u * --b->n_waiting);
    uint8_t *message = b->waiting[b->n_waiting++];
    sb_store(message, code, 2);
    message[2] = bits;
    memcpy(&message[3], data, 5);
}

void sb_clear_history(struct sb_board *b)
{
    const struct sb_run *run = sb_find(0x1003, 1);
    sb_put(b, 0x1003, 0, 0);
    if (run)
        memset(&b->image[run->at], 0, 4u * run->n);
}

bool sb_error(struct sb_board *b, uint16_t code, uint8_t bits, const uint8_t *data)
{
    static const uint8_t none[5];
    const unsigned kind = code >> 12; /* the bit that CiA 301, table 26 gives it, and the generic one */
    data = data ? data : none;
    for (unsigned i = 0; i < b->n_errors; i++)
        if (b->errors[i].code == code && memcmp(b->errors[i].data, data, 5) == 0)
            return false;
    if (b->n_errors == SB_ERRORS)
        return false;
    struct sb_error *error = &b->errors[b->n_errors++];
    if (!bits)
        bits = kind == 2 ? 0x02 : kind == 3 ? 0x04 : kind == 4 ? 0x08 : kind == 8 ? 0x10 : kind == 15 ? 0x80 : 0;
    error->code = code;
    error->bits = bits | 0x01;
    memcpy(error->data, data, 5);
    const struct sb_run *run = sb_find(0x1003, 1);
    if (run) {
        uint8_t *history = &b->image[run->at];
        const uint32_t n = sb_get(b, 0x1003, 0);
        memmove(&history[4], history, 4u * (run->n - 1u));
        sb_store(history, code | sb_load(data, 2) << 16, 4);
        sb_put(b, 0x1003, 0, n < run->n ? n + 1 : n);
    }
    emcy_queue(b, code, data);
    return true;
}

bool sb_error_end(struct sb_board *b, uint16_t code, const uint8_t *data)
{
    bool is_gone = false;
    for (unsigned i = 0; i < b->n_errors;) {
        if (b->errors[i].code != code || (data && memcmp(b->errors[i].data, data, 5) != 0)) {
            i++;
            continue;
        }
        uint8_t ended[5];
        sb_store(ended, code, 2);
        memcpy(&ended[2], b->errors[i].data, 3);
        memmove(&b->errors[i], &b->errors[i + 1], (--b->n_errors - i) * sizeof *b->errors);
        emcy_queue(b, 0, ended);
        is_gone = true;
    }
    return is_gone;
}

static void emcy_reset(struct sb_board *b)
{
    b->n_errors = b->n_waiting = 0;
    b->emcy_free = 0;
    sb_put(b, 0x1001, 0, 0);
    sb_clear_history(b);
}

/* --- Error control: heartbeat, node guarding, the heartbeats of others ---------------------------- */

static uint64_t after(const struct sb_board *b, uint32_t time_ms)
{
    return time_ms ? b->now + 1000u * (uint64_t)time_ms : SB_NEVER;
}

static void heartbeat_tick(struct sb_board *b)
{
    if (b->now < b->beat)
        return;
    if (!sb_send(b, 0x700u + b->node_id, &b->state, 1, true)) {
        b->beat = b->now + RETRY_US;
        return;
    }
    const uint32_t period = 1000u * sb_get(b, 0x1017, 0);
    b->beat += period; /* beats that were missed are not made up for */
    if (b->beat <= b->now)
        b->beat = b->now + period;
}

/* What 0x1029 says of a lost heartbeat (CiA 301, 7.5.2.28). */
static void communication_error(struct sb_board *b)
{
    const uint32_t choice = sb_get(b, 0x1029, 1);
    if (b->state == SB_OPERATIONAL && (choice == 0 || choice == 2))
        sb_enter(b, choice ? SB_STOPPED : SB_PRE_OPERATIONAL);
}

static uint32_t life_time(const struct sb_board *b)
{
    return sb_get(b, 0x100C, 0) * sb_get(b, 0x100D, 0);
}

static void guarding_answer(struct sb_board *b)
{
    if (sb_get(b, 0x1017, 0))
        return;
    const uint8_t state = (uint8_t)(b->state | (b->guard_toggle ? 0x80 : 0));
    sb_send(b, 0x700u + b->node_id, &state, 1, true);
    b->guard_toggle = !b->guard_toggle;
    if (b->is_guard_lost)
        sb_error_end(b, ERROR_HEARTBEAT, (const uint8_t[5]){0});
    b->is_guard_lost = false;
    b->guard_due = after(b, life_time(b));
}

static void guarding_tick(struct sb_board *b)
{
    if (b->now < b->guard_due)
        return;
    b->guard_due = SB_NEVER;
    b->is_guard_lost = true;
    sb_error(b, ERROR_HEARTBEAT, 0, NULL);
    communication_error(b);
}

static void watched_error(struct sb_board *b, const struct sb_watched *node, bool is_lost)
{
    const uint8_t data[5] = {node->node_id};
    if (is_lost)
        sb_error(b, ERROR_HEARTBEAT, 0, data);
    else
        sb_error_end(b, ERROR_HEARTBEAT, data);
}

/* Take over 0x1016; what is known of nodes that stay as they were is kept, if it is to be. */
static void watch(struct sb_board *b, bool keeps)
{
    struct sb_watched before[SB_CONSUMED_ROOM];
    memcpy(before, b->watched, sizeof before);
    for (uint8_t i = 0; i < SB_CONSUMED_ROOM; i++) {
        const uint32_t value = sb_get(b, 0x1016, (uint8_t)(i + 1));
        const uint8_t node_id = (uint8_t)(value >> 16);
        struct sb_watched *node = &b->watched[i];
        memset(node, 0, sizeof *node);
        node->due = SB_NEVER;
        if ((value & 0xFFFF) == 0 || node_id < 1 || node_id > 127)
            continue;
        node->node_id = node_id;
        node->time = (uint16_t)value;
        for (unsigned k = 0; keeps && k < SB_CONSUMED_ROOM; k++)
            if (before[k].node_id == node_id && before[k].time == node->time) {
                *node = before[k];
                before[k].is_lost = false;
            }
    }
    for (unsigned k = 0; keeps && k < SB_CONSUMED_ROOM; k++)
        if (before[k].node_id && before[k].is_lost)
            watched_error(b, &before[k], false);
}

/* Return which entry of 0x1016 an identifier is of, SB_CONSUMED_ROOM for none. */
static unsigned entry_of(const struct sb_board *b, uint16_t id)
{
    unsigned i = 0;
    while (i < SB_CONSUMED_ROOM && !(b->watched[i].node_id && id == 0x700u + b->watched[i].node_id))
        i++;
    return i;
}

static void consumer_receive(struct sb_board *b, struct sb_watched *node, const struct sb_frame *frame)
{
    const uint8_t state = frame->data[0] & 0x7F;
    if (frame->length != 1 || (state != SB_INITIALISING && state != SB_STOPPED && state != SB_OPERATIONAL &&
                               state != SB_PRE_OPERATIONAL)) {
        b->dropped++;
        return;
    }
    /* after a boot-up the next heartbeat may be long in coming */
    node->due = state == SB_INITIALISING ? SB_NEVER : after(b, node->time);
    if (node->is_lost)
        watched_error(b, node, false);
    node->is_lost = false;
}

static void consumer_tick(struct sb_board *b)
{
    bool is_lost = false;
    for (unsigned i = 0; i < SB_CONSUMED_ROOM; i++)
        if (b->now >= b->watched[i].due) {
            b->watched[i].due = SB_NEVER;
            b->watched[i].is_lost = is_lost = true;
            watched_error(b, &b->watched[i], true);
        }
    if (is_lost)
        communication_error(b);
}

/* --- SYNC ----------------------------------------------------------------------------------------- */

static void sync_receive(struct sb_board *b, const struct sb_frame *frame)
{
    const unsigned length = sb_get(b, 0x1019, 0) ? 1 : 0;
    const uint32_t window = sb_get(b, 0x1007, 0);
    if (frame->length != length) {
        if (!b->is_sync_length_wrong)
            sb_error(b, ERROR_SYNC_LENGTH, 0, NULL);
        b->is_sync_length_wrong = true;
        if (frame->length > 1) {
            b->dropped++;
            return;
        } /* with a counter too many or too few it counts all the same */
    } else if (b->is_sync_length_wrong) {
        b->is_sync_length_wrong = false;
        sb_error_end(b, ERROR_SYNC_LENGTH, NULL);
    }
    if (window) {
        const uint32_t age = frame->t_us ? (uint32_t)b->now - frame->t_us : 0;
        b->sync_closes = b->now - (age >> 31 ? 0 : age) + window;
    }
    sb_pdo_sync(b, frame->length ? frame->data[0] : 0);
}

/* --- NMT (CiA 301, 7.3.2) ------------------------------------------------------------------------- */

void sb_enter(struct sb_board *b, uint8_t state)
{
    b->state = state;
    if (!has_emcy(state)) {
        b->sync_closes = SB_NEVER;
        b->sdo_command = 0;
        b->is_sync_length_wrong = b->is_sync_length_wrong && state == SB_STOPPED;
    }
    sb_pdo_enter(b);
    emcy_tick(b);
}

static void boot(struct sb_board *b, bool is_application)
{
    const bool is_loaded = sb_storage_load(b, is_application);
    sb_marks_loaded(b, is_application);
    emcy_reset(b);
    b->beat = b->guard_due = SB_NEVER;
    b->guard_toggle = b->is_guard_lost = false;
    sb_pdo_configure(b);
    watch(b, false);
    if (b->node_id == SB_UNCONFIGURED)
        return;
    if (!is_loaded)
        sb_error(b, ERROR_DATA_SET, 0, NULL);
    sb_send(b, 0x700u + b->node_id, &b->state, 1, true);
    b->beat = after(b, sb_get(b, 0x1017, 0));
    sb_enter(b, SB_PRE_OPERATIONAL);
}

void sb_reset(struct sb_board *b, bool is_application)
{
    sb_enter(b, SB_INITIALISING);
    b->lss_configures = false;
    b->lss_asked = 0;
    b->node_id = b->next_node_id;
    sb_load_defaults(b, false, is_application);
    boot(b, is_application);
}

void sb_command(struct sb_board *b, uint8_t command)
{
    const uint8_t state = command == SB_START ? SB_OPERATIONAL
                          : command == SB_STOP ? SB_STOPPED
                                               : SB_PRE_OPERATIONAL;
    if (command == SB_RESET_NODE || command == SB_RESET_COMMUNICATION)
        sb_reset(b, command == SB_RESET_NODE);
    else if ((command == SB_START || command == SB_STOP || command == SB_ENTER_PRE_OPERATIONAL) &&
             state != b->state)
        sb_enter(b, state);
}

/* --- Rules of the objects of this file ------------------------------------------------------------ */

void sb_node_changed(struct sb_board *b, uint16_t index)
{
    if (index == 0x1017 && is_running(b))
        b->beat = sb_get(b, 0x1017, 0) ? b->now : SB_NEVER; /* a time that is written starts it at once */
    else if ((index == 0x100C || index == 0x100D) && !life_time(b))
        b->guard_due = SB_NEVER;
    else if (index == 0x1016)
        watch(b, true);
    else if (index == 0x1007 && !sb_get(b, 0x1007, 0))
        b->sync_closes = SB_NEVER;
}

uint32_t sb_node_check(const struct sb_board *b, uint16_t index, uint8_t sub, uint32_t value)
{
    const uint32_t old = sb_get(b, index, sub);
    if (index == 0x1003)
        return value ? ABORT_VALUE : 0;
    if (index == 0x1005) /* a board does not produce SYNC */
        return value & ~(COB_INVALID | 0x7FFu) || sb_is_restricted(value & 0x7FF) ? ABORT_VALUE : 0;
    if (index == 0x1014)
        return value & ~(COB_INVALID | 0x7FFu) || (!(value & COB_INVALID) && sb_is_restricted(value)) ||
                       (!((old | value) & COB_INVALID) && value != old)
                   ? ABORT_VALUE
                   : 0;
    if (index == 0x1019)
        return value == 1 || value > 240 ? ABORT_VALUE : 0;
    if (index == 0x1016) {
        const uint32_t node_id = value & 0xFFFF ? value >> 16 & 0xFF : 0;
        if (sub == 0 || value >> 24)
            return sub ? ABORT_VALUE : ABORT_READ_ONLY;
        for (uint8_t other = 1; other <= SB_CONSUMED_ROOM; other++) {
            const uint32_t taken = sb_get(b, 0x1016, other);
            if (node_id && node_id < 128 && other != sub && taken & 0xFFFF && (taken >> 16 & 0xFF) == node_id)
                return ABORT_INCOMPATIBLE;
        }
    }
    return 0;
}

/* --- What a port calls ---------------------------------------------------------------------------- */

void sb_init(struct sb_board *b, uint8_t node_id, uint32_t serial, size_t flash_bytes)
{
    void *port = b->port;
    memset(b, 0, sizeof *b);
    b->port = port;
    b->flash_bytes = flash_bytes;
    b->node_id = b->next_node_id = node_id;
    b->lss_bit_rate = 0xFF;
    b->beat = b->guard_due = b->sync_closes = SB_NEVER;
    if (SB_LSS)
        sb_storage_power_on(b);
    sb_load_defaults(b, true, true);
    if (serial)
        sb_put(b, 0x1018, 4, serial);
    sb_pdo_configure(b);
}

static void be_booted(struct sb_board *b, uint32_t now_us)
{
    b->now += (uint32_t)(now_us - (uint32_t)b->now);
    if (!b->is_booted) {
        b->is_booted = true;
        boot(b, true);
    }
}

enum service { NOBODY, NMT, SYNC, SDO, RPDO, GUARDING, CONSUMER, LSS };

/* Return the service that a frame is for in this state; of two for one identifier, the first. */
static enum service service_of(const struct sb_board *b, uint16_t id, bool is_remote)
{
    const bool is_served = has_emcy(b->state);
    if (is_remote)
        return is_running(b) && SB_GUARDING && id == 0x700u + b->node_id ? GUARDING : NOBODY;
    if (id == 0 && is_running(b))
        return NMT;
    if (is_served && id == (sb_get(b, 0x1005, 0) & 0x7FF))
        return SYNC;
    if (is_served && id == sb_sdo_id(b, 1))
        return SDO;
    if (b->state == SB_OPERATIONAL && sb_rpdo_hears(b, id))
        return RPDO;
    if (is_running(b) && entry_of(b, id) < SB_CONSUMED_ROOM)
        return CONSUMER;
    return SB_LSS && b->state != SB_OPERATIONAL && id == 0x7E5 ? LSS : NOBODY;
}

bool sb_hears(const struct sb_board *b, uint16_t id, bool is_remote)
{
    return service_of(b, id, is_remote) != NOBODY;
}

void sb_receive(struct sb_board *b, const struct sb_frame *frame, uint32_t now_us)
{
    be_booted(b, now_us);
    const enum service service = service_of(b, frame->id, frame->flags & SB_REMOTE);
    if (service != NOBODY && frame->flags & SB_FD) {
        b->dropped++;
        return;
    }
    switch (service) {
    case NMT:
        if (frame->length == 2 && (frame->data[1] == 0 || frame->data[1] == b->node_id))
            sb_command(b, frame->data[0]);
        break;
    case SYNC: sync_receive(b, frame); break;
    case SDO: sb_sdo_receive(b, frame); break;
    case RPDO: sb_rpdo_receive(b, frame); break;
    case GUARDING: guarding_answer(b); break;
    case CONSUMER: consumer_receive(b, &b->watched[entry_of(b, frame->id)], frame); break;
    case LSS: sb_lss_receive(b, frame); break;
    case NOBODY: break;
    }
}

static uint64_t earlier(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

uint32_t sb_poll(struct sb_board *b, uint32_t now_us)
{
    be_booted(b, now_us);
    sb_events(b);
    sb_sdo_tick(b);
    heartbeat_tick(b);
    consumer_tick(b);
    guarding_tick(b);
    sb_rpdo_tick(b);
    sb_tpdo_tick(b);
    emcy_tick(b);
    uint64_t wake = earlier(earlier(b->beat, b->guard_due), earlier(emcy_wake(b), sb_pdo_wake(b)));
    if (b->sdo_command)
        wake = earlier(wake, b->sdo_deadline);
    for (unsigned i = 0; i < SB_CONSUMED_ROOM; i++)
        wake = earlier(wake, b->watched[i].due);
    if (wake <= b->now)
        return 1;
    return wake - b->now < UINT32_MAX ? (uint32_t)(wake - b->now) : UINT32_MAX;
}
