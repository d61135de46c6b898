/* A tactile board as a CANopen device: what its parts share, and what the board layer gives and takes.
 *
 * There is no heap, no clock and no thread: the main loop of a port passes frames and the time, see sb_receive
 * and sb_poll. All state of a board is in one struct sb_board. Sources: CiA 301, 305 and 401.
 */
#ifndef SKIN_H
#define SKIN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board.h" /* made from the EDS: sizes, which the Makefile may replace, and the tables declared below */

#define SB_ERRORS 16   /* errors that are there at once */
#define SB_WAITING 32  /* EMCY messages that wait */
#define SB_NOWHERE 0xFFFFu
#define SB_UNCONFIGURED 0xFFu /* node-ID of a board that has none */
#define SB_NEVER UINT64_MAX
#define SB_PROGRAMS 2u
#define SB_PROGRAM_MARKS 16u /* bytes at the end of such a page, after the room for an image */
#define SB_PROGRAM_ROOM (SB_PROGRAM_BYTES ? SB_PROGRAM_BYTES - SB_PROGRAM_MARKS : 0)
#define SB_GFC 0x001 /* global fail-safe command (EN 50325-5) */

/* --- The object dictionary, as tables ------------------------------------------------------------- */

enum { SB_READ = 1, SB_WRITE = 2, SB_MAP_TX = 4, SB_MAP_RX = 8, SB_RELATIVE = 16 /* to the node-ID */ };
enum { SB_SIGNED = 32, SB_BOOLEAN = 64, SB_REAL = 128 };
enum { SB_VERIFIED = 256 /* is in the checksum */ };
enum { SB_COMMUNICATION = 512, SB_APPLICATION = 1024, SB_MANUFACTURER = 2048 }; /* what it is stored with */
enum { SB_PARAMETER = SB_COMMUNICATION | SB_APPLICATION | SB_MANUFACTURER /* is stored */, SB_LSS_GROUP = 4096 };

struct sb_run { /* consecutive sub-indices of one kind */
    uint16_t index;
    uint8_t sub, n, size; /* bytes of each; 0: a text, which has its length in two bytes before it */
    uint8_t limit;       /* number in sb_limits */
    uint16_t access, at; /* at: offset in the image */
};
extern const struct sb_run sb_runs[SB_N_RUNS];
extern const uint8_t sb_defaults[SB_DEFAULTS]; /* of the image up to the texts that can be written, which have none */
extern const int64_t sb_limits[SB_N_LIMITS][2]; /* lowest and highest value; of a text 0 and its most bytes */
extern const uint16_t sb_guarded[]; /* of a stop relay: identifiers of the states of guards */
extern const uint16_t sb_pdos[]; /* indices of their communication parameters, those of RPDOs first */

/* --- Frames and the board layer ------------------------------------------------------------------- */

struct sb_frame {
    uint16_t id;   /* 11 bits; a port passes on no extended frames and no error frames */
    uint8_t flags; /* SB_REMOTE, SB_FD */
    uint8_t length;
    bool expires;  /* of a frame to send: not after the time t_us, also not out of a buffer of the controller */
    uint32_t t_us; /* of a received frame: when its last bit came, or 0 if that is not known */
    uint8_t data[SB_FRAME_BYTES];
};
enum { SB_REMOTE = 1, SB_FD = 2 };
enum { SB_OLD = 1, SB_UNSETTLED = 2 }; /* nobody knows when it was sampled; the converter has not settled */

struct sb_board;

/* A port implements these; its main loop calls sb_receive for each frame and then sb_poll. */
bool can_send(struct sb_board *b, const struct sb_frame *frame, bool urgent); /* false: no room now; urgent
    frames have a mailbox of their own, or heartbeats and EMCY wait behind readings; so has SB_GFC, or it waits
    behind those */
bool can_receive(struct sb_board *b, struct sb_frame *frame); /* false: no more */
uint32_t micros(struct sb_board *b);                          /* may wrap around */
uint8_t sample(struct sb_board *b, int16_t readings[SB_N_TACTELS], uint16_t *age_100us); /* left-adjusted;
    returns SB_OLD, SB_UNSETTLED or 0; age: time from sampling to now */
bool flash_read(struct sb_board *b, unsigned page, size_t at, uint8_t *data, size_t n);
bool flash_write(struct sb_board *b, unsigned page, size_t at, const uint8_t data[8]); /* at 0: erases the page
    first, from its beginning */
void restart(struct sb_board *b); /* as by power-on, once what can_send took is sent: the boot program starts what
    sb_program_choose returns */
void relay_output(struct sb_board *b, bool closed); /* of a stop relay only, which has no tactels and no flash */

/* --- State ---------------------------------------------------------------------------------------- */

enum { SB_INITIALISING = 0, SB_STOPPED = 4, SB_OPERATIONAL = 5, SB_PRE_OPERATIONAL = 127 };
enum { SB_START = 1, SB_STOP = 2, SB_ENTER_PRE_OPERATIONAL = 128, SB_RESET_NODE = 129, SB_RESET_COMMUNICATION = 130 };

struct sb_slot {
    uint8_t *at; /* in the image; NULL: a dummy */
    uint16_t index;
    uint8_t sub, bits;
};
struct sb_pdo {
    uint64_t free, due; /* end of the inhibit time, of the event time */
    uint16_t index, id, inhibit, timer;
    uint8_t type, start, length, n_slots;
    uint8_t countdown; /* SYNCs to the next transmission */
    bool is_sent, has_readings, valid, awaits_start, requested; /* is_sent: a TPDO */
    bool is_waiting; /* an RPDO waits for SYNC, with its data */
    uint8_t data[SB_FRAME_BYTES];
    struct sb_slot slots[SB_PDO_ENTRIES];
};
struct sb_error {
    uint16_t code;
    uint8_t bits, data[5];
};
struct sb_watched { /* a node that shows that it lives, its value in 0x1016, and when it is lost */
    uint64_t due;
    uint32_t value;
};

struct sb_board {
    void *port;   /* of the board layer */
    uint64_t now; /* us; sb_init clears from here on */
    uint8_t node_id, next_node_id, bit_rate, state;
    bool is_booted, is_mark_old; /* a parameter that outlives a reset of the communication was changed */
    size_t flash_bytes;          /* of a page; 0: nothing can be stored */

    uint32_t (*on_write)(struct sb_board *, uint16_t index, uint8_t sub, const uint8_t *data); /* may be NULL; an
        abort code refuses a write from the bus, such as a command (0x2050) */
    void (*on_bit_rate)(struct sb_board *, uint8_t index, uint16_t delay_ms); /* may be NULL; LSS */

    uint64_t beat, emcy_free, sync_closes, sampled; /* sampled: between SYNCs */
    uint8_t guard_toggle;
    uint8_t beyond;   /* bit k: whether the guard found sample k before the newest one beyond a limit */
    bool is_stop_due; /* GFC found no room */

    struct sb_error errors[SB_ERRORS];
    uint8_t n_errors, n_waiting, waiting[SB_WAITING][8];
    struct sb_watched watched[1 + SB_CONSUMED_ROOM]; /* by sub-index of 0x1016; the first one guards this node */
    struct sb_pdo pdos[SB_N_PDOS]; /* in the order of sb_pdos */
    uint8_t sample_status;
    int16_t sent[SB_N_TACTELS]; /* readings that events were last told of */
    bool is_sent_known[SB_N_TACTELS];

    uint8_t sdo_command, sdo_sub, sdo_toggle; /* command 0: no transfer */
    uint16_t sdo_index;
    uint32_t sdo_least, sdo_most, sdo_done; /* bytes */
    uint8_t *sdo_data, sdo_buffer[SB_GUARD_ROOM]; /* for numbers, too */
    uint64_t sdo_deadline;

    unsigned program_slot; /* of the program that runs */
    uint8_t program_status;
    bool has_new_program, is_slot_used, is_restarting; /* used: the other slot was written since it was cleared */
    uint32_t program_sequence, program_crc;

    bool lss_configures;
    uint8_t lss_scanned, lss_next; /* the command that goes on with naming a board */

    uint8_t image[SB_IMAGE];
};

/* --- For ports ------------------------------------------------------------------------------------ */

void sb_init(struct sb_board *b, uint8_t node_id, uint32_t serial, size_t flash_bytes); /* keeps b->port */
unsigned sb_program_choose(struct sb_board *b, bool is_start); /* for a boot program, true: returns the page whose
    program is to start, 0 for none; needs b->port only */
void sb_receive(struct sb_board *b, const struct sb_frame *frame, uint32_t now_us);
uint32_t sb_poll(struct sb_board *b, uint32_t now_us); /* returns the us until it wants to be called again */
bool sb_hears(struct sb_board *b, uint16_t id, bool is_remote); /* for filters of the controller */
void sb_command(struct sb_board *b, uint8_t command);
bool sb_request(struct sb_board *b, uint16_t index); /* a TPDO, by its first object, or all that carry an object;
    false if none is sent on events now */
bool sb_error(struct sb_board *b, uint16_t code, uint8_t bits, const uint8_t *data); /* data: 5 bytes or NULL */
bool sb_error_end(struct sb_board *b, uint16_t code, const uint8_t *data);           /* NULL: all with this code */
bool sb_set(struct sb_board *b, uint16_t index, uint8_t sub, const uint8_t *data, uint32_t n); /* no rights */

/* One turn of a main loop; returns the us until the next one, or until a frame comes. */
static inline uint32_t sb_turn(struct sb_board *b)
{
    struct sb_frame frame;
    while (can_receive(b, &frame))
        sb_receive(b, &frame, micros(b));
    return sb_poll(b, micros(b));
}

/* --- Between the parts ---------------------------------------------------------------------------- */

enum {
    ABORT_TOGGLE = 0x05030000, ABORT_TIMEOUT = 0x05040000, ABORT_COMMAND = 0x05040001, ABORT_MEMORY = 0x05040005,
    ABORT_ACCESS = 0x06010000, ABORT_WRITE_ONLY = 0x06010001, ABORT_READ_ONLY = 0x06010002,
    ABORT_NO_OBJECT = 0x06020000, ABORT_NOT_MAPPABLE = 0x06040041, ABORT_PDO_TOO_LONG = 0x06040042,
    ABORT_INCOMPATIBLE = 0x06040043, ABORT_HARDWARE = 0x06060000, ABORT_LENGTH_HIGH = 0x06070012,
    ABORT_LENGTH_LOW = 0x06070013, ABORT_NO_SUB_INDEX = 0x06090011, ABORT_VALUE = 0x06090030,
    ABORT_VALUE_HIGH = 0x06090031, ABORT_VALUE_LOW = 0x06090032, ABORT_NOT_STORED = 0x08000020,
    ABORT_LOCAL_CONTROL = 0x08000021, ABORT_DEVICE_STATE = 0x08000022, ABORT_NO_DATA = 0x08000024
};
enum {
    ERROR_DATA_SET = 0x6300, ERROR_COMMUNICATION = 0x8100, ERROR_HEARTBEAT = 0x8130, ERROR_PDO_LENGTH = 0x8210,
    ERROR_PDO_TOO_LONG = 0x8220, ERROR_SYNC_LENGTH = 0x8240, ERROR_RPDO_TIMEOUT = 0x8250, ERROR_GUARD = 0xFF02
};
#define COB_INVALID 0x80000000u
#define COB_NO_RTR 0x40000000u
#define COB_EXTENDED 0x20000000u

static inline uint64_t sb_earlier(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

static inline uint32_t sb_load(const uint8_t *data, unsigned n)
{
    uint32_t value = 0;
    while (n--)
        value = value << 8 | data[n];
    return value;
}

static inline void sb_store(uint8_t *data, uint32_t value, unsigned n)
{
    for (unsigned i = 0; i < n; i++, value >>= 8)
        data[i] = (uint8_t)value;
}

/* object.c */
const struct sb_run *sb_find(uint16_t index, uint8_t sub); /* NULL if there is none */
uint8_t *sb_at(struct sb_board *b, uint16_t index, uint8_t sub);
uint32_t sb_get(const struct sb_board *b, uint16_t index, uint8_t sub);
void sb_put(struct sb_board *b, uint16_t index, uint8_t sub, uint32_t value);
void sb_load_defaults(struct sb_board *b, bool is_application);
bool sb_is_default(const struct sb_board *b, const struct sb_run *run);
void sb_clear_marks(struct sb_board *b);
uint32_t sb_room(const struct sb_run *run); /* bytes that each value of a run can have */
uint32_t sb_check(const struct sb_run *run, const uint8_t *data);
uint32_t sb_check_cob_id(uint32_t value, uint32_t old, uint32_t allowed);
uint32_t sb_permit(uint16_t index, uint8_t sub, uint8_t right);
uint32_t sb_read(struct sb_board *b, uint16_t index, uint8_t sub, uint8_t **data, uint32_t *n);
uint32_t sb_write(struct sb_board *b, uint16_t index, uint8_t sub, const uint8_t *data, uint32_t n);
uint32_t sb_crc(uint32_t crc, const uint8_t *data, size_t n);

/* node.c */
uint64_t sb_emcy_tick(struct sb_board *b);
bool sb_send(struct sb_board *b, uint32_t id, const uint8_t *data, uint8_t n, bool urgent);
void sb_report(struct sb_board *b, uint16_t code, uint16_t of, bool is_there);
void sb_reset(struct sb_board *b, bool is_application);
uint64_t sb_after(const struct sb_board *b, uint32_t time_ms); /* SB_NEVER for 0 */
void sb_node_changed(struct sb_board *b, uint16_t index);
uint32_t sb_node_check(struct sb_board *b, uint16_t index, uint8_t sub, uint32_t value);

/* sdo.c */
void sb_sdo_receive(struct sb_board *b, const struct sb_frame *frame);
uint64_t sb_sdo_tick(struct sb_board *b); /* this and the other ticks return when they want to be called again */
uint32_t sb_sdo_id(const struct sb_board *b, uint8_t sub);

/* pdo.c */
void sb_pdo_configure(struct sb_board *b);
void sb_pdo_enter(struct sb_board *b);
void sb_pdo_changed(struct sb_board *b, uint16_t index);
uint32_t sb_pdo_check(struct sb_board *b, uint16_t index, uint8_t sub, uint32_t value);
bool sb_rpdo_hears(const struct sb_board *b, uint16_t id);
void sb_rpdo_receive(struct sb_board *b, const struct sb_frame *frame);
void sb_pdo_sync(struct sb_board *b, uint8_t counter);
uint64_t sb_pdo_tick(struct sb_board *b);
uint64_t sb_scan_tick(struct sb_board *b);
int32_t sb_reading(const struct sb_board *b, unsigned tactel); /* from 0 */
void sb_sample(struct sb_board *b);

/* guard.c */
bool sb_guards(struct sb_board *b);
uint32_t sb_guard_check(uint16_t index, const uint8_t *data, uint32_t n);
uint32_t sb_guard_acknowledge(struct sb_board *b, uint32_t word);
void sb_guard_changed(struct sb_board *b, uint16_t index);
void sb_guard_compare(struct sb_board *b);

/* lss.c */
void sb_lss_receive(struct sb_board *b, const struct sb_frame *frame);

/* storage.c */
bool sb_storage_load(struct sb_board *b, unsigned groups); /* false: damaged, or of another device */
uint32_t sb_storage_command(struct sb_board *b, uint16_t index, uint8_t sub, const uint8_t *data);
uint32_t sb_storage_keep_node_id(struct sb_board *b);

/* program.c */
enum { SB_PROGRAM_DATA = 0x1F50, SB_PROGRAM_CONTROL = 0x1F51, SB_PROGRAM_SOFTWARE = 0x1F56, SB_ON_TRIAL = 0x80 };
void sb_program_confirm(struct sb_board *b);
uint32_t sb_program_command(struct sb_board *b, uint8_t command);
uint32_t sb_program_begin(struct sb_board *b);
uint32_t sb_program_take(struct sb_board *b, const uint8_t *data, uint32_t n, bool is_last);

#endif
