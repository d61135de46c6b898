"""Conformance rows: TPDOs on SYNC, on events and on timers; RPDOs into the dictionary."""

from tests.node.node_table import MASTER, PATCH, Row, reads, refuses, writes

SET = [0x1234, -2, 3, 0x7FFF]  # readings 1-4 as the patch's own program samples them
TPDO1 = "<- 180+n 34 12 FE FF 03 00 FF 7F"
ZERO = "00 00 00 00 00 00 00 00"
NEXT = [f"<- 280+n {ZERO}", f"<- 380+n {ZERO}", f"<- 480+n {ZERO}"]
ALL = [TPDO1, *NEXT]


def sample(device):
    device.image_view(0x6401, 1, 4)[:] = SET


def tell(index, sub, value):
    return lambda device: device.set(index, sub, value)


def ask(number):
    return lambda device: device.transmit_tpdo(number)


def only_tpdo1(kind, **others):
    """TPDO 1 alone, of the given type; the device's own program sets it."""

    def act(device):
        for number in (2, 3, 4):
            device.set(0x17FF + number, 1, 0xC0000000)
        device.set(0x1800, 2, kind)
        for name, value in others.items():
            device.set(0x1800, {"inhibit": 3, "event": 5, "start": 6}[name], value)
        sample(device)

    return act


def rpdo(*mapping, cob_id=0x211, kind=255, event=0):
    """RPDO 1 maps these values."""

    def act(device):
        device.set(0x1600, 0, len(mapping))
        for i, value in enumerate(mapping):
            device.set(0x1600, 1 + i, value)
        device.set(0x1400, 2, kind)
        device.set(0x1400, 5, event)
        device.set(0x1400, 1, cob_id)

    return act


COMMAND = 0x2050_00_20
GOT = []  # what the application saw of writes


def note_writes(device):
    GOT.clear()
    device.on_write = lambda index, sub, value: GOT.append((index, sub, value))


def wanted(*writes):
    def act(device):
        assert list(writes) == GOT

    return act


TPDO_ROWS = [
    Row("type 1 on every SYNC", "301 7.5.2.37", [sample, "-> 080", *ALL, "-> 080", *ALL], state="op"),
    Row(
        "SYNC without its counter still counts",
        "301 7.2.5",
        [sample, tell(0x1019, 0, 240), "-> 080", *ALL, "<- 080+n 40 82 11 00 00 00 00 00 ; wrong length"],
        state="op",
    ),
    Row(
        "type 3 on every third SYNC",
        "301 7.5.2.37",
        [
            only_tpdo1(3),
            "-> 080",
            "-> 080",
            "-> 080",
            TPDO1,
            "-> 080",
            "-> 080",
            "-> 080",
            TPDO1,
        ],
        state="op",
    ),
    Row(
        "type 240 on the last SYNC it can wait for",
        "301 7.5.2.37",
        [only_tpdo1(240), *["-> 080"] * 240, TPDO1],
        state="op",
    ),
    Row(
        "SYNCs are counted from the start",
        "301 7.5.2.37",
        [only_tpdo1(2), "-> 080", "-> 000 80 nn", "-> 000 01 nn", "-> 080", "-> 080", TPDO1],
        state="op",
    ),
    Row(
        "the SYNC start value is the first SYNC",
        "301 7.5.2.37",
        [
            tell(0x1019, 0, 240),
            only_tpdo1(2, start=4),
            "-> 000 80 nn",
            "-> 000 01 nn",
            "-> 080 01",
            "-> 080 02",
            "-> 080 03",
            "-> 080 04",
            "-> 080 05",
            TPDO1,
            "-> 080 06",
            "-> 080 07",
            TPDO1,
        ],
        state="op",
    ),
    Row(
        "a start value with type 1",
        "301 7.5.2.37",
        [
            tell(0x1019, 0, 240),
            only_tpdo1(1, start=2),
            "-> 000 80 nn",
            "-> 000 01 nn",
            "-> 080 01",
            "-> 080 02",
            TPDO1,
            "-> 080 03",
            TPDO1,
        ],
        state="op",
    ),
    Row(
        "type 0 on the SYNC after an event",
        "301 7.5.2.37",
        [only_tpdo1(0), "-> 080", ask(1), "-> 080", TPDO1, "-> 080"],
        state="op",
    ),
    Row("type 254 on an event", "301 7.5.2.37", [only_tpdo1(254), "-> 080", ask(1), TPDO1], state="op"),
    Row("type 255 on an event", "301 7.5.2.37", [only_tpdo1(255), ask(1), TPDO1, "++ 1000"], state="op"),
    Row("a cyclic PDO has no events", "301 7.5.2.37", [only_tpdo1(1), ask(1), "++ 10"], state="op"),
    Row("no event outside operational", "301 7.3.2.2.5", [only_tpdo1(254), ask(1), "-> 000 01 nn", "++ 10"]),
    Row(
        "an event before stop is forgotten",
        "301 7.3.2.2.5",
        [only_tpdo1(0), ask(1), "-> 000 80 nn", "-> 000 01 nn", "-> 080"],
        state="op",
    ),
    Row(
        "the event timer sends without events",
        "301 7.5.2.37",
        [only_tpdo1(254, event=20), "++ 19", "++ 1", TPDO1, "++ 20", TPDO1],
        state="op",
    ),
    Row(
        "an event restarts the event timer",
        "301 7.5.2.37",
        [only_tpdo1(254, event=20), "++ 15", ask(1), TPDO1, "++ 19", "++ 1", TPDO1],
        state="op",
    ),
    Row(
        "the inhibit time keeps events apart",
        "301 7.5.2.37",
        [only_tpdo1(254, inhibit=50), ask(1), TPDO1, "++ 1", ask(1), "++ 3.9", "++ 0.1", TPDO1],
        state="op",
    ),
    Row(
        "many events in the inhibit time are one",
        "301 7.5.2.37",
        [only_tpdo1(254, inhibit=50), ask(1), TPDO1, ask(1), ask(1), ask(1), "++ 5", TPDO1, "++ 20"],
        state="op",
    ),
    Row(
        "the values are those of the moment of sending",
        "301 7.2.2",
        [
            only_tpdo1(254, inhibit=50),
            ask(1),
            TPDO1,
            ask(1),
            tell(0x6401, 1, 1),
            "++ 5",
            "<- 180+n 01 00 FE FF 03 00 FF 7F",
        ],
        state="op",
    ),
]

RPDO_ROWS = [
    Row(
        "an RPDO writes its objects",
        "301 7.5.2.35",
        [rpdo(COMMAND), note_writes, "-> 211 78 56 34 12", wanted((0x2050, 0, 0x12345678))],
        state="op",
    ),
    Row(
        "no RPDO outside operational",
        "301 7.3.2.2.5",
        [rpdo(COMMAND), note_writes, "-- 211", "-> 211 78 56 34 12", wanted()],
    ),
    Row(
        "an RPDO waits for SYNC",
        "301 7.5.2.35",
        [
            rpdo(COMMAND, kind=1),
            only_tpdo1(254),
            note_writes,
            "-> 211 01 00 00 00",
            "-> 211 02 00 00 00",
            wanted(),
            "-> 080",
            wanted((0x2050, 0, 2)),
            "-> 080",
            wanted((0x2050, 0, 2)),
        ],
        state="op",
    ),
    Row(
        "an RPDO that is too short changes nothing",
        "301 7.2.2.2",
        [
            rpdo(COMMAND),
            note_writes,
            "-> 211 78 56 34",
            "<- 080+n 10 82 11 11 02 00 00 00",
            wanted(),
            "-> 211 01 00 00 00",
            "<- 080+n 00 00 00 10 82 11 02 00",
            wanted((0x2050, 0, 1)),
        ],
        state="op",
    ),
    Row(
        "an RPDO that is too long counts as far as it is mapped",
        "301 7.2.2.2",
        [
            rpdo(COMMAND),
            note_writes,
            "-> 211 01 00 00 00 99",
            "<- 080+n 20 82 11 11 02 00 00 00",
            wanted((0x2050, 0, 1)),
            "-> 211 02 00 00 00",
            "<- 080+n 00 00 00 20 82 11 02 00",
        ],
        state="op",
    ),
    Row(
        "an error of a PDO is told once",
        "301 7.2.7.1",
        [rpdo(COMMAND), "-> 211 78", "<- 080+n 10 82 11 11 02 00 00 00", "-> 211 78", "-> 211"],
        state="op",
    ),
    Row(
        "a dummy skips bytes",
        "301 7.4.7.1",
        [
            rpdo(0x0005_00_08, COMMAND, 0x0006_00_10),
            note_writes,
            "-> 211 FF 01 02 03 04 FF FF",
            wanted((0x2050, 0, 0x04030201)),
        ],
        state="op",
    ),
    Row(
        "the deadline of an RPDO begins with the first",
        "301 7.5.2.35",
        [
            rpdo(COMMAND, event=50),
            "++ 500",
            "-> 211 01 00 00 00",
            "++ 49",
            "-> 211 01 00 00 00",
            "++ 49",
            "++ 1",
            "<- 080+n 50 82 11 11 02 00 00 00",
            "++ 500",
            "-> 211 01 00 00 00",
            "<- 080+n 00 00 00 50 82 11 02 00",
        ],
        state="op",
    ),
    Row(
        "an RPDO that is switched off has no length",
        "301 7.5.2.35",
        [
            rpdo(COMMAND),
            "-> 211 78",
            "<- 080+n 10 82 11 11 02 00 00 00",
            *writes("1400:01", "11 02 00 80"),
            "<- 080+n 00 00 00 10 82 11 02 00",
            *reads("1001:00", "00"),
        ],
        state="op",
    ),
    Row(
        "an RPDO that is switched off is not late",
        "301 7.5.2.35",
        [
            rpdo(COMMAND, event=50),
            "-> 211 01 00 00 00",
            "++ 50",
            "<- 080+n 50 82 11 11 02 00 00 00",
            *writes("1400:01", "11 02 00 80"),
            "<- 080+n 00 00 00 50 82 11 02 00",
            *writes("1400:01", "12 02 00 00"),
            "++ 500",
        ],
        state="op",
    ),
    Row(
        "an RPDO without deadline is not late",
        "301 7.5.2.35",
        [
            rpdo(COMMAND, event=50),
            "-> 211 01 00 00 00",
            "++ 50",
            "<- 080+n 50 82 11 11 02 00 00 00",
            *writes("1400:05", "00 00"),
            "<- 080+n 00 00 00 50 82 11 02 00",
        ],
        state="op",
    ),
    Row(
        "a remote frame is no RPDO",
        "301 7.2.2",
        [rpdo(COMMAND, cob_id=0x80000211), note_writes, "-- 211", "-> 211 01 00 00 00", wanted()],
        state="op",
    ),
]

MASTER_ROWS = [
    Row(
        "a contact goes out on an event",
        "301 7.5.2.37",
        [
            tell(0x3001, 1, 7),
            tell(0x3001, 3, -2),
            tell(0x3001, 5, 500),
            ask(2),
            "<- 681 07 00 FE FF 00 00 F4 01",
        ],
        state="op",
    ),
    Row("the summary goes out on an event", "301 7.5.2.37", [ask(1), f"<- 180+n {ZERO}"], state="op"),
    Row(
        "objects of several kinds in one PDO",
        "301 7.4.8",
        [
            tell(0x2100, 1, 1),
            tell(0x2100, 2, 2),
            tell(0x2100, 5, 0x0505),
            ask(1),
            "<- 180+n 01 02 00 00 05 05 00 00",
        ],
        state="op",
    ),
    Row("the master's PDO has a reserved type", "301 7.5.2.37", refuses("1801:02", "FB", 0x06090030)),
]
ROWS = []
for rows, on in ((TPDO_ROWS, PATCH), (RPDO_ROWS, PATCH), (MASTER_ROWS, MASTER)):
    ROWS += [Row(r.name, r.section, r.steps, r.state, on) for r in rows]
