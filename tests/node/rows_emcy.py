"""Conformance rows: EMCY, error register and history; SYNC; heartbeat consumer; error behaviour."""

from tests.node.node_table import MASTER, PATCH, Row, no, reads, refuses, up, writes

E8110 = "<- 080+n 10 81 11 00 00 00 00 00"


def error(code, register=0, data=b""):
    return lambda device: device.emcy(code, register, data)


def repaired(code, data=None):
    return lambda device: device.emcy_clear(code, data)


def tell(index, sub, value):
    return lambda device: device.set(index, sub, value)


OFF = writes("1014:00", "90 00 00 80")
WATCH_9 = writes("1016:01", "64 00 09 00")  # node 9 within 100 ms
LOST_9 = "<- 080+n 30 81 11 09 00 00 00 00"
BACK_9 = "<- 080+n 00 00 00 30 81 09 00 00"

EMCY_ROWS = [
    Row("an error is told", "301 7.2.7.1", [error(0x8110), E8110]),
    Row(
        "an error with data",
        "301 7.2.7.3",
        [error(0x5000, 0x81, b"\x01\x02\x03\x04\x05"), "<- 080+n 00 50 81 01 02 03 04 05"],
    ),
    Row("an error is told once", "301 7.2.7.1", [error(0x8110), E8110, error(0x8110), "++ 100"]),
    Row("the error register follows", "301 7.5.2.2", [error(0x8110), E8110, *reads("1001:00", "11")]),
    Row(
        "two errors and their register",
        "301 7.5.2.2",
        [
            error(0x8110),
            E8110,
            error(0x4200),
            "<- 080+n 00 42 19 00 00 00 00 00",
            repaired(0x8110),
            "<- 080+n 00 00 09 10 81 00 00 00",
            *reads("1001:00", "09"),
            repaired(0x4200),
            "<- 080+n 00 00 00 00 42 00 00 00",
            *reads("1001:00", "00"),
        ],
    ),
    Row("what was no error is not repaired", "301 7.2.7.1", [repaired(0x8110), "++ 10"]),
    Row(
        "no error in stopped, told afterwards",
        "301 7.3.2.2.5",
        [error(0x8110), "++ 10", "-> 000 80 nn", E8110],
        state="stopped",
    ),
    Row("errors in operational", "301 7.3.2.2.5", [error(0x8110), E8110], state="op"),
    Row(
        "the history counts",
        "301 7.5.2.4",
        [
            *reads("1003:00", "00"),
            error(0x8110),
            E8110,
            *reads("1003:00", "01"),
            *reads("1003:01", "10 81 00 00"),
        ],
    ),
    Row(
        "the newest error stands first",
        "301 7.5.2.4",
        [
            error(0x8110),
            E8110,
            error(0x8120, 0, b"\x07\x08"),
            "<- 080+n 20 81 11 07 08 00 00 00",
            *reads("1003:01", "20 81 07 08"),
            *reads("1003:02", "10 81 00 00"),
        ],
    ),
    Row("the history has no data beyond its end", "301 7.5.2.4", [up("1003:01"), no("1003:01", 0x08000024)]),
    Row(
        "the history is full and the oldest falls out",
        "301 7.5.2.4",
        [
            *[s for i in range(9) for s in (error(0xFF00 + i), f"<- 080+n {i:02X} FF 81 00 00 00 00 00")],
            *reads("1003:00", "08"),
            *reads("1003:01", "08 FF 00 00"),
            *reads("1003:08", "01 FF 00 00"),
        ],
    ),
    Row(
        "0 clears the history",
        "301 7.5.2.4",
        [error(0x8110), E8110, *writes("1003:00", "00"), *reads("1003:00", "00"), *reads("1001:00", "11")],
    ),
    Row("nothing else may be written to the history", "301 7.5.2.4", refuses("1003:00", "01", 0x06090030)),
    Row(
        "no entry of the history can be written", "301 7.5.2.4", refuses("1003:01", "00 00 00 00", 0x06010002)
    ),
    Row(
        "the inhibit time keeps messages apart",
        "301 7.5.2.18",
        [
            *writes("1015:00", "64 00"),
            error(0x8110),
            E8110,
            error(0x8120),
            "++ 9.9",
            "++ 0.1",
            "<- 080+n 20 81 11 00 00 00 00 00",
        ],
    ),
    Row(
        "what waits goes out in order",
        "301 7.5.2.18",
        [
            *writes("1015:00", "64 00"),
            error(0x8110),
            E8110,
            error(0x8120),
            error(0x8140),
            "++ 10",
            "<- 080+n 20 81 11 00 00 00 00 00",
            "++ 10",
            "<- 080+n 40 81 11 00 00 00 00 00",
            "++ 100",
        ],
    ),
    Row(
        "EMCY off",
        "301 7.5.2.17",
        [
            "-> 600+n 23 14 10 00 nn 00 00 80",
            "<- 580+n 60 14 10 00 00 00 00 00",
            error(0x8110),
            "++ 10",
            *reads("1003:00", "01"),
        ],
    ),
    Row(
        "EMCY on another identifier",
        "301 7.5.2.17",
        [
            *writes("1014:00", "90 00 00 80"),
            *writes("1014:00", "90 00 00 00"),
            error(0x8110),
            "<- 090 10 81 11 00 00 00 00 00",
        ],
    ),
    Row(
        "the identifier of a valid EMCY stays", "301 7.5.2.17", refuses("1014:00", "99 00 00 00", 0x06090030)
    ),
    *[
        Row(
            f"no EMCY on the identifier of {what}",
            "301 7.3.5",
            [*OFF, *refuses("1014:00", value, 0x06090030), *writes("1014:00", "90 00 00 00")],
        )
        for what, value in (("NMT", "00 00 00 00"), ("an SDO", "01 06 00 00"), ("a heartbeat", "05 07 00 00"))
    ],
    Row("no extended EMCY", "301 7.5.2.17", refuses("1014:00", "99 00 00 A0", 0x06090030)),
    Row(
        "a reset clears errors",
        "301 7.3.2.2",
        [
            error(0x8110),
            E8110,
            "-> 000 82 nn",
            "<- 700+n 00",
            *reads("1001:00", "00"),
            *reads("1003:00", "00"),
        ],
    ),
]

SYNC_ROWS = [
    Row(
        "SYNC of the wrong length, told once",
        "301 7.2.5",
        [
            tell(0x1019, 0, 240),
            "-> 080",
            "<- 080+n 40 82 11 00 00 00 00 00",
            "-> 080",
            "-> 080 01",
            "<- 080+n 00 00 00 40 82 00 00 00",
        ],
        on=PATCH,
    ),
    Row(
        "a counter that is not wanted is of the wrong length, told once",
        "301 7.2.5",
        [
            "-> 080 01",
            "<- 080+n 40 82 11 00 00 00 00 00",
            "-> 080 02",
            "-> 080",
            "<- 080+n 00 00 00 40 82 00 00 00",
        ],
        on=PATCH,
    ),
    Row("as delivered SYNC has no counter", "301 7.5.2.22", reads("1019:00", "00")),
    Row(
        "SYNC of the right length ends the error, after stopped too",
        "301 7.2.5",
        [
            tell(0x1019, 0, 240),
            "-> 080",
            "<- 080+n 40 82 11 00 00 00 00 00",
            "-> 000 02 nn",
            "-> 000 80 nn",
            "-> 080 01",
            "<- 080+n 00 00 00 40 82 00 00 00",
            *reads("1001:00", "00"),
        ],
        on=PATCH,
    ),
    Row(
        "SYNC of eight bytes is dropped",
        "301 7.2.5",
        ["-> 080 01 02 03 04 05 06 07 08", "<- 080+n 40 82 11 00 00 00 00 00"],
        on=PATCH,
    ),
    Row(
        "SYNC without counter where none is set",
        "301 7.5.2.22",
        ["-> 080", *writes("1019:00", "0A"), "-> 080 01", *writes("1019:00", "00"), "-> 080"],
        on=PATCH,
    ),
    Row("a counter overflow of 1", "301 7.5.2.22", refuses("1019:00", "01", 0x06090030)),
    Row("a counter overflow beyond 240", "301 7.5.2.22", refuses("1019:00", "F1", 0x06090031)),
    Row(
        "no new overflow while SYNC runs",
        "301 7.5.2.22",
        [tell(0x1006, 0, 20000), *refuses("1019:00", "0A", 0x08000022)],
        on=MASTER,
    ),
    Row(
        "SYNC on another identifier",
        "301 7.5.2.5",
        [*writes("1005:00", "81 00 00 00"), "-- 080", "-> 081"],
        on=PATCH,
    ),
    Row("no SYNC on a reserved identifier", "301 7.5.2.5", refuses("1005:00", "05 07 00 00", 0x06090030)),
    Row("no extended SYNC", "301 7.5.2.5", refuses("1005:00", "80 00 00 20", 0x06090030)),
    Row("a patch cannot make SYNC", "301 7.5.2.5", refuses("1005:00", "80 00 00 40", 0x06090030), on=PATCH),
    Row(
        "the master makes SYNC with a counter",
        "301 7.5.2.6",
        [tell(0x1019, 0, 240), tell(0x1006, 0, 20000), "++ 20", "<- 080 01", "++ 20", "<- 080 02"],
        on=MASTER,
    ),
    Row(
        "the counter overflows to 1",
        "301 7.2.5",
        [
            *writes("1019:00", "02"),
            tell(0x1006, 0, 20000),
            "++ 20",
            "<- 080 01",
            "++ 20",
            "<- 080 02",
            "++ 20",
            "<- 080 01",
        ],
        on=MASTER,
    ),
    Row(
        "SYNC without counter",
        "301 7.5.2.22",
        [tell(0x1006, 0, 20000), "++ 20", "<- 080"],
        on=MASTER,
    ),
    Row(
        "a stopped master makes no SYNC, and begins at 1",
        "301 7.2.5",
        [
            tell(0x1019, 0, 240),
            tell(0x1006, 0, 20000),
            "++ 20",
            "<- 080 01",
            "-> 000 02 nn",
            "++ 100",
            "-> 000 80 nn",
            "++ 20",
            "<- 080 01",
        ],
        on=MASTER,
    ),
    Row(
        "the identifier of a SYNC in production stays",
        "301 7.5.2.5",
        refuses("1005:00", "81 00 00 40", 0x06090030),
        on=MASTER,
    ),
    Row(
        "production ends",
        "301 7.5.2.5",
        [tell(0x1006, 0, 20000), "++ 20", "<- 080", *writes("1005:00", "80 00 00 00"), "++ 100"],
        on=MASTER,
    ),
]

HEARTBEAT_ROWS = [
    Row(
        "a lost heartbeat is an error",
        "301 7.2.8.3.2.2",
        [*WATCH_9, "-> 709 05", "++ 99", "++ 1", LOST_9, "++ 1000"],
    ),
    Row(
        "a heartbeat in time is none",
        "301 7.2.8.3.2.2",
        [*WATCH_9, "-> 709 05", "++ 90", "-> 709 05", "++ 90", "-> 709 05"],
    ),
    Row("nobody is missed before the first heartbeat", "301 7.2.8.3.2.2", [*WATCH_9, "++ 5000"]),
    Row(
        "a heartbeat that comes back",
        "301 7.2.8.3.2.2",
        [*WATCH_9, "-> 709 05", "++ 100", LOST_9, "-> 709 05", BACK_9],
    ),
    Row(
        "a boot-up ends the watch",
        "301 7.2.8.3.2.2",
        [*WATCH_9, "-> 709 05", "++ 50", "-> 709 00", "++ 1000"],
    ),
    Row(
        "a boot-up repairs a loss",
        "301 7.2.8.3.2.2",
        [*WATCH_9, "-> 709 7F", "++ 100", LOST_9, "-> 709 00", BACK_9, "++ 1000"],
    ),
    Row("a heartbeat of two bytes is none", "301 7.2.8.3.2.2", [*WATCH_9, "-> 709 05 00", "++ 1000"]),
    Row("a heartbeat of no state is none", "301 7.2.8.3.2.2", [*WATCH_9, "-> 709 22", "++ 1000"]),
    Row(
        "the toggle bit of node guarding is not looked at",
        "301 7.2.8.3.2.1",
        [*WATCH_9, "-> 709 85", "++ 100", LOST_9],
    ),
    Row(
        "no node is watched twice", "301 7.5.2.19", [*WATCH_9, *refuses("1016:02", "C8 00 09 00", 0x06040043)]
    ),
    Row(
        "an entry may be written again",
        "301 7.5.2.19",
        [*WATCH_9, *writes("1016:01", "C8 00 09 00"), "-> 709 05", "++ 199", "++ 1", LOST_9],
    ),
    Row(
        "0 ms watches nobody",
        "301 7.5.2.19",
        [*WATCH_9, "-> 709 05", *writes("1016:01", "00 00 09 00"), "-- 709", "++ 1000"],
    ),
    Row("node 200 is nobody", "301 7.5.2.19", [*writes("1016:01", "64 00 C8 00"), "++ 1000"]),
    Row("reserved bits of an entry", "301 7.5.2.19", refuses("1016:01", "64 00 09 01", 0x06090030)),
    Row(
        "a lost heartbeat leads out of operational",
        "301 7.5.2.28",
        [*WATCH_9, "-> 709 05", "++ 100", LOST_9, "-- 211", *writes("1017:00", "0A 00"), "<- 700+n 7F"],
        state="op",
        on=PATCH,
    ),
    Row(
        "or into stopped",
        "301 7.5.2.28",
        [*writes("1029:01", "02"), *WATCH_9, "-> 709 05", "++ 100", "-- 600+n", "-> 000 80 nn", LOST_9],
        state="op",
    ),
    Row(
        "or nowhere",
        "301 7.5.2.28",
        [
            *writes("1029:01", "01"),
            *WATCH_9,
            "-> 709 05",
            "++ 100",
            LOST_9,
            *writes("1017:00", "0A 00"),
            "<- 700+n 05",
        ],
        state="op",
    ),
    Row(
        "pre-operational stays as it is",
        "301 7.5.2.28",
        [*writes("1029:01", "02"), *WATCH_9, "-> 709 05", "++ 100", LOST_9, *reads("1001:00", "11")],
    ),
    Row(
        "a stopped node watches on",
        "301 7.3.2.2.5",
        [*WATCH_9, "-> 709 05", "-> 000 02 nn", "++ 100", "-> 000 80 nn", LOST_9],
    ),
]

ROWS = [*EMCY_ROWS, *SYNC_ROWS, *HEARTBEAT_ROWS]
