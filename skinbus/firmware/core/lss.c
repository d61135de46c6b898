/* The LSS slave: node-ID and bit rate given over the bus; fastscan finds boards without node-ID (CiA 305). */
#include "skin.h"

enum {
    SWITCH_GLOBAL = 0x04, CONFIGURE_NODE_ID = 0x11, CONFIGURE_BIT_TIMING = 0x13, ACTIVATE_BIT_TIMING = 0x15,
    STORE = 0x17, SWITCH_VENDOR = 0x40, SWITCH_SERIAL = 0x43, SWITCHED = 0x44, IDENTIFY_VENDOR = 0x46,
    IDENTIFY_SERIAL_HIGH = 0x4B, IDENTIFY_UNCONFIGURED = 0x4C, IDENTIFIED = 0x4F, IS_UNCONFIGURED = 0x50,
    FASTSCAN = 0x51, INQUIRE_VENDOR = 0x5A, INQUIRE_SERIAL = 0x5D, INQUIRE_NODE_ID = 0x5E
};

static void answer(struct sb_board *b, uint8_t command, uint32_t value)
{
    uint8_t data[8] = {command};
    sb_store(&data[1], value, 4);
    sb_send(b, 0x7E4, data, 8, false);
}

static uint32_t identity(const struct sb_board *b, unsigned part)
{
    return sb_get(b, 0x1018, (uint8_t)(1 + part));
}

static bool is_unconfigured(const struct sb_board *b)
{
    return b->node_id == SB_UNCONFIGURED && b->next_node_id == SB_UNCONFIGURED;
}

/* One of the commands that follow each other to name a board or a range; true if it is the last and all fit. */
static bool is_named(struct sb_board *b, uint8_t command, uint8_t first, uint8_t last, bool is_ours)
{
    const bool goes_on = is_ours && (command == first || command == b->lss_next);
    b->lss_next = goes_on ? (uint8_t)(command + 1) : 0;
    return goes_on && command == last;
}

static void switch_global(struct sb_board *b, uint8_t mode)
{
    if (mode > 1)
        return;
    b->lss_configures = mode;
    b->lss_next = 0;
    if (!mode && b->node_id == SB_UNCONFIGURED && b->next_node_id != SB_UNCONFIGURED)
        sb_reset(b, true);
}

/* Answer while the bits asked so far are ours; the last bit of the last number switches this board. */
static void fastscan(struct sb_board *b, const uint8_t *data)
{
    const uint8_t bit = data[5], part = data[6], following = data[7];
    if (!is_unconfigured(b))
        return;
    if (bit == 0x80)
        b->lss_scanned = 0;
    else if (bit < 32 && part < 4 && following < 4 && part == b->lss_scanned &&
             sb_load(&data[1], 4) >> bit == identity(b, part) >> bit) {
        b->lss_scanned = following;
        b->lss_configures = bit == 0 && following < part;
    } else
        return;
    answer(b, IDENTIFIED, 0);
}

static void configure(struct sb_board *b, uint8_t command, const uint8_t *data)
{
    if (command == CONFIGURE_NODE_ID) {
        const bool is_good = (data[1] >= 1 && data[1] <= 127) || data[1] == SB_UNCONFIGURED;
        b->next_node_id = is_good ? data[1] : b->next_node_id;
        answer(b, command, !is_good);
    } else if (command == CONFIGURE_BIT_TIMING) {
        const bool is_good = data[1] == 0 && data[2] < 9 && SB_BIT_RATES >> data[2] & 1;
        b->bit_rate = is_good ? data[2] : b->bit_rate;
        answer(b, command, !is_good);
    } else if (command == ACTIVATE_BIT_TIMING) { /* the port waits the delay, switches, and waits the delay again */
        if (b->bit_rate != 0xFF && b->on_bit_rate)
            b->on_bit_rate(b, b->bit_rate, (uint16_t)sb_load(&data[1], 2));
    } else if (command == STORE)
        answer(b, command, sb_storage_keep_node_id(b));
    else if (command == INQUIRE_NODE_ID)
        answer(b, command, b->node_id);
    else if (command >= INQUIRE_VENDOR && command <= INQUIRE_SERIAL)
        answer(b, command, identity(b, command - (unsigned)INQUIRE_VENDOR));
}

void sb_lss_receive(struct sb_board *b, const struct sb_frame *frame)
{
    /* of the commands that identify: which number each is about, and whether that is equal, its low or high end */
    static const uint8_t parts[] = {0, 1, 2, 2, 3, 3};
    const uint8_t *data = frame->data, command = data[0];
    const uint32_t number = sb_load(&data[1], 4);
    if (frame->length != 8)
        return;
    if (command == SWITCH_GLOBAL)
        switch_global(b, data[1]);
    else if (command == IDENTIFY_UNCONFIGURED) {
        if (is_unconfigured(b))
            answer(b, IS_UNCONFIGURED, 0);
    } else if (command >= IDENTIFY_VENDOR && command <= IDENTIFY_SERIAL_HIGH) {
        const unsigned step = command - (unsigned)IDENTIFY_VENDOR;
        const uint32_t own = identity(b, parts[step]);
        const bool is_ours = step < 2 ? own == number : step % 2 == 0 ? own >= number : own <= number;
        if (is_named(b, command, IDENTIFY_VENDOR, IDENTIFY_SERIAL_HIGH, is_ours))
            answer(b, IDENTIFIED, 0);
    } else if (b->lss_configures)
        configure(b, command, data);
    else if (command >= SWITCH_VENDOR && command <= SWITCH_SERIAL) {
        const bool is_ours = identity(b, command - (unsigned)SWITCH_VENDOR) == number;
        b->lss_configures = is_named(b, command, SWITCH_VENDOR, SWITCH_SERIAL, is_ours);
        if (b->lss_configures)
            answer(b, SWITCHED, 0);
    } else if (command == FASTSCAN)
        fastscan(b, data);
}
