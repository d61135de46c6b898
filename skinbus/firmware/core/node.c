/* NMT, error control, EMCY and SYNC of one board; which service a frame is for, and when to be called again. */
#include <string.h>

#include "skin.h"

#define EMCY_RETRY_US 50000u /* ten waiting frames take 11 ms at 125 kbit/s */
#define RETRY_US 1000u

static bool has_emcy(uint8_t state)
{
    return state == SB_PRE_OPERATIONAL || state == SB_OPERATIONAL;
}

bool sb_send(struct sb_board *b, uint32_t id, const uint8_t *data, uint8_t n, bool urgent)
{
    struct sb_frame frame = {.id = (uint16_t)(id & 0x7FF), .length = n};
    memcpy(frame.data, data, n);
    return can_send(b, &frame, urgent);
}

/* --- EMCY, error register and history (CiA 301, 7.2.7) -------------------------------------------- */

uint64_t sb_emcy_tick(struct sb_board *b)
{
    if (!has_emcy(b->state))
        return SB_NEVER;
    while (b->n_waiting && b->now >= b->emcy_free) {
        const uint32_t id = sb_get(b, 0x1014, 0);
        if (!(id & COB_INVALID)) {
            if (!sb_send(b, id, b->waiting[0], 8, true)) {
                b->emcy_free = b->now + EMCY_RETRY_US;
                break;
            }
            b->emcy_free = b->now + 100u * sb_get(b, 0x1015, 0);
        }
        memmove(b->waiting[0], b->waiting[1], 8u * --b->n_waiting);
    }
    return b->n_waiting ? b->emcy_free : SB_NEVER;
}

static void emcy_queue(struct sb_board *b, uint16_t code, const uint8_t data[5])
{
    uint8_t bits = 0;
    for (unsigned i = 0; i < b->n_errors; i++)
        bits |= b->errors[i].bits;
    sb_put(b, 0x1001, 0, bits);
    if (b->n_waiting == SB_WAITING) /* the oldest is lost; the history still has its error */
        memmove(b->waiting[0], b->waiting[1], 8u * --b->n_waiting);
    uint8_t *message = b->waiting[b->n_waiting++];
    sb_store(message, code, 2);
    message[2] = bits;
    memcpy(&message[3], data, 5);
}

bool sb_error(struct sb_board *b, uint16_t code, uint8_t bits, const uint8_t *data)
{
    static const uint8_t none[5], by_kind[16] = {[2] = 0x02, [3] = 0x04, [4] = 0x08, [8] = 0x10, [15] = 0x80};
    data = data ? data : none;
    for (unsigned i = 0; i < b->n_errors; i++)
        if (b->errors[i].code == code && memcmp(b->errors[i].data, data, 5) == 0)
            return false;
    if (b->n_errors == SB_ERRORS)
        return false;
    struct sb_error *error = &b->errors[b->n_errors++];
    error->code = code;
    error->bits = (bits ? bits : by_kind[code >> 12]) | 0x01; /* CiA 301, table 26, and the generic one */
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

/* An error is there, or it is not; each change is told once. Its data name an object, an identifier or a node. */
void sb_report(struct sb_board *b, uint16_t code, uint16_t of, bool is_there)
{
    const uint8_t data[5] = {(uint8_t)of, (uint8_t)(of >> 8)};
    if (is_there)
        sb_error(b, code, 0, data);
    else
        sb_error_end(b, code, data);
}

static void enter(struct sb_board *b, uint8_t state)
{
    b->state = state;
    if (!has_emcy(state)) {
        b->sync_closes = SB_NEVER;
        b->sdo_command = 0;
    }
    if (state == SB_OPERATIONAL)
        sb_program_confirm(b);
    sb_pdo_enter(b);
    sb_emcy_tick(b);
}

/* --- Error control: heartbeat, node guarding, the heartbeats of others ---------------------------- */

uint64_t sb_after(const struct sb_board *b, uint32_t time_ms)
{
    return time_ms ? b->now + 1000u * (uint64_t)time_ms : SB_NEVER;
}

static uint64_t heartbeat_tick(struct sb_board *b)
{
    const uint32_t period = 1000u * sb_get(b, 0x1017, 0);
    if (b->now < b->beat)
        return b->beat;
    if (!sb_send(b, 0x700u + b->node_id, &b->state, 1, true))
        b->beat = b->now + RETRY_US;
    else if ((b->beat += period) <= b->now) /* beats that were missed are not made up for */
        b->beat = b->now + period;
    return b->beat;
}

static uint32_t life_time(const struct sb_board *b)
{
    return sb_get(b, 0x100C, 0) * sb_get(b, 0x100D, 0);
}

static uint8_t watched_id(uint32_t value)
{
    const uint32_t node_id = value >> 16;
    return value & 0xFFFF && node_id < 128 ? (uint8_t)node_id : 0;
}

static void hear(struct sb_board *b, struct sb_watched *node, uint32_t time_ms)
{
    node->due = sb_after(b, time_ms);
    sb_report(b, ERROR_HEARTBEAT, watched_id(node->value), false);
}

static void guarding_receive(struct sb_board *b, const struct sb_frame *frame)
{
    const uint8_t state = b->state | b->guard_toggle;
    (void)frame;
    if (sb_get(b, 0x1017, 0))
        return;
    sb_send(b, 0x700u + b->node_id, &state, 1, true);
    b->guard_toggle ^= 0x80;
    hear(b, &b->watched[0], life_time(b));
}

/* Take over 0x1016; what is known of nodes that stay as they were is kept. */
static void watch(struct sb_board *b)
{
    for (uint8_t i = 1; i <= SB_CONSUMED_ROOM; i++) {
        const uint32_t value = sb_get(b, 0x1016, i);
        if (value == b->watched[i].value)
            continue;
        if (watched_id(b->watched[i].value))
            sb_report(b, ERROR_HEARTBEAT, watched_id(b->watched[i].value), false);
        b->watched[i] = (struct sb_watched){SB_NEVER, value};
    }
}

/* Return the entry of 0x1016 that an identifier is of, NULL for none. */
static struct sb_watched *watched_of(struct sb_board *b, uint16_t id)
{
    for (unsigned i = 1; i <= SB_CONSUMED_ROOM; i++)
        if (id > 0x700 && id - 0x700u == watched_id(b->watched[i].value))
            return &b->watched[i];
    return NULL;
}

static void heartbeat_receive(struct sb_board *b, const struct sb_frame *frame)
{
    struct sb_watched *node = watched_of(b, frame->id);
    const uint8_t state = frame->data[0] & 0x7F;
    if (frame->length == 1 && (state == SB_INITIALISING || state == SB_STOPPED || state == SB_OPERATIONAL ||
                               state == SB_PRE_OPERATIONAL)) /* after a boot-up the next one may be long in coming */
        hear(b, node, state == SB_INITIALISING ? 0 : node->value & 0xFFFF);
}

static uint64_t watched_tick(struct sb_board *b)
{
    const uint32_t choice = sb_get(b, 0x1029, 1);
    uint64_t wake = SB_NEVER;
    bool is_lost = false;
    for (struct sb_watched *node = b->watched; node <= b->watched + SB_CONSUMED_ROOM; node++) {
        if (b->now >= node->due) {
            node->due = SB_NEVER;
            is_lost = true;
            sb_report(b, ERROR_HEARTBEAT, watched_id(node->value), true);
        }
        wake = sb_earlier(wake, node->due);
    }
    if (is_lost && b->state == SB_OPERATIONAL && (choice | 2) == 2) /* CiA 301, 7.5.2.28 */
        enter(b, choice ? SB_STOPPED : SB_PRE_OPERATIONAL);
    return wake;
}

/* --- SYNC ----------------------------------------------------------------------------------------- */

static void sync_receive(struct sb_board *b, const struct sb_frame *frame)
{
    const uint32_t window = sb_get(b, 0x1007, 0);
    sb_report(b, ERROR_SYNC_LENGTH, 0, frame->length != (sb_get(b, 0x1019, 0) ? 1 : 0));
    if (frame->length > 1) /* with a counter too many or too few it counts all the same */
        return;
    if (window) {
        const uint32_t age = frame->t_us ? (uint32_t)b->now - frame->t_us : 0;
        b->sync_closes = b->now - (age >> 31 ? 0 : age) + window;
    }
    sb_pdo_sync(b, frame->length ? frame->data[0] : 0);
}

/* --- NMT (CiA 301, 7.3.2) ------------------------------------------------------------------------- */

static void boot(struct sb_board *b, bool is_application)
{
    const bool is_loaded = sb_storage_load(b, is_application ? SB_PARAMETER : SB_COMMUNICATION);
    b->is_mark_old = b->is_mark_old && !is_application;
    if (b->is_mark_old)
        sb_clear_marks(b);
    b->emcy_free = b->n_errors = b->n_waiting = b->guard_toggle = 0;
    sb_put(b, 0x1001, 0, 0);
    sb_put(b, 0x1003, 0, 0);
    sb_put(b, SB_GUARD, 1, 0);
    sb_put(b, SB_GUARD, 2, 0);
    sb_program_choose(b, false);
    b->beat = b->sync_closes = SB_NEVER;
    sb_pdo_configure(b);
    for (unsigned i = 0; i <= SB_CONSUMED_ROOM; i++)
        b->watched[i] = (struct sb_watched){SB_NEVER, 0};
    watch(b);
    if (b->node_id == SB_UNCONFIGURED)
        return;
    if (!is_loaded)
        sb_error(b, ERROR_DATA_SET, 0, NULL);
    sb_send(b, 0x700u + b->node_id, &b->state, 1, true);
    b->beat = sb_after(b, sb_get(b, 0x1017, 0));
    enter(b, SB_PRE_OPERATIONAL);
}

void sb_reset(struct sb_board *b, bool is_application)
{
    enter(b, SB_INITIALISING);
    b->lss_next = b->lss_configures = false;
    b->node_id = b->next_node_id;
    sb_load_defaults(b, is_application);
    boot(b, is_application);
}

void sb_command(struct sb_board *b, uint8_t command)
{
    const uint8_t state = command == SB_START ? SB_OPERATIONAL
                          : command == SB_STOP ? SB_STOPPED
                          : command == SB_ENTER_PRE_OPERATIONAL ? SB_PRE_OPERATIONAL : b->state;
    if (command == SB_RESET_NODE && (b->has_new_program || b->program_status == SB_ON_TRIAL))
        b->is_restarting = true;
    else if (command == SB_RESET_NODE || command == SB_RESET_COMMUNICATION)
        sb_reset(b, command == SB_RESET_NODE);
    else if (state != b->state)
        enter(b, state);
}

static void nmt_receive(struct sb_board *b, const struct sb_frame *frame)
{
    if (frame->length == 2 && (frame->data[1] == 0 || frame->data[1] == b->node_id))
        sb_command(b, frame->data[0]);
}

/* --- Rules of the objects of this file ------------------------------------------------------------ */

void sb_node_changed(struct sb_board *b, uint16_t index)
{
    if (index == 0x1017 && b->state != SB_INITIALISING)
        b->beat = sb_get(b, 0x1017, 0) ? b->now : SB_NEVER; /* a time that is written starts it at once */
    else if ((index == 0x100C || index == 0x100D) && !life_time(b))
        b->watched[0].due = SB_NEVER;
    else if (index == 0x1016)
        watch(b);
    else if (index == 0x1007 && !sb_get(b, 0x1007, 0))
        b->sync_closes = SB_NEVER;
}

uint32_t sb_node_check(struct sb_board *b, uint16_t index, uint8_t sub, uint32_t value)
{
    if ((index == 0x1003 && value) || (index == 0x1019 && (value == 1 || value > 240)) ||
        (index == 0x1016 && value >> 24))
        return ABORT_VALUE;
    if (index == 0x1005) /* a board does not produce SYNC, and its bit 31 means nothing */
        return sb_check_cob_id(value & ~COB_INVALID, COB_INVALID, 0);
    if (index == 0x1014)
        return sb_check_cob_id(value, sb_get(b, 0x1014, 0), 0);
    for (uint8_t other = 1; index == 0x1016 && watched_id(value) && other <= SB_CONSUMED_ROOM; other++)
        if (other != sub && watched_id(sb_get(b, 0x1016, other)) == watched_id(value))
            return ABORT_INCOMPATIBLE;
    return 0;
}

/* --- What a port calls ---------------------------------------------------------------------------- */

void sb_init(struct sb_board *b, uint8_t node_id, uint32_t serial, size_t flash_bytes)
{
    memset(&b->now, 0, sizeof *b - offsetof(struct sb_board, now));
    b->flash_bytes = flash_bytes;
    b->node_id = b->next_node_id = node_id;
    b->bit_rate = 0xFF;
    memcpy(b->image, sb_defaults, SB_DEFAULTS);
    sb_storage_load(b, SB_LSS_GROUP);
    sb_load_defaults(b, true);
    if (serial)
        sb_put(b, 0x1018, 4, serial);
}

static void be_booted(struct sb_board *b, uint32_t now_us)
{
    b->now += (uint32_t)(now_us - (uint32_t)b->now);
    if (!b->is_booted) {
        b->is_booted = true;
        boot(b, true);
    }
}

typedef void receiver(struct sb_board *, const struct sb_frame *);

/* Return who takes a frame in this state, NULL for nobody; of two for one identifier, the first. */
static receiver *receiver_of(struct sb_board *b, uint16_t id, bool is_remote)
{
    const bool is_served = has_emcy(b->state), is_running = b->state != SB_INITIALISING;
    if (is_remote)
        return is_running && sb_find(0x100C, 0) && id == 0x700u + b->node_id ? guarding_receive : NULL;
    if (id == 0 && is_running)
        return nmt_receive;
    if (is_served && id == (sb_get(b, 0x1005, 0) & 0x7FF))
        return sync_receive;
    if (is_served && id == sb_sdo_id(b, 1))
        return sb_sdo_receive;
    if (b->state == SB_OPERATIONAL && sb_rpdo_hears(b, id))
        return sb_rpdo_receive;
    if (is_running && watched_of(b, id))
        return heartbeat_receive;
    return SB_LSS && b->state != SB_OPERATIONAL && id == 0x7E5 ? sb_lss_receive : NULL;
}

bool sb_hears(struct sb_board *b, uint16_t id, bool is_remote)
{
    return receiver_of(b, id, is_remote) != NULL;
}

void sb_receive(struct sb_board *b, const struct sb_frame *frame, uint32_t now_us)
{
    be_booted(b, now_us);
    receiver *const receive = receiver_of(b, frame->id, frame->flags & SB_REMOTE);
    if (receive && !(frame->flags & SB_FD))
        receive(b, frame);
}

uint32_t sb_poll(struct sb_board *b, uint32_t now_us)
{
    static uint64_t (*const ticks[])(struct sb_board *) = {
        sb_scan_tick, sb_sdo_tick, heartbeat_tick, watched_tick, sb_pdo_tick, sb_emcy_tick};
    uint64_t wake = SB_NEVER;
    be_booted(b, now_us);
    if (b->is_restarting) {
        restart(b);
        return 1;
    }
    for (unsigned i = 0; i < sizeof ticks / sizeof *ticks; i++)
        wake = sb_earlier(wake, ticks[i](b));
    return (uint32_t)sb_earlier(wake > b->now ? wake - b->now : 1, UINT32_MAX);
}
