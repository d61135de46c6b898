"""Conformance rows: the synchronous window (0x1007), and the stamp that samples carry (0x2070)."""

from skinbus.can.frame import Frame
from skinbus.objects.profile import SampleStatus
from tests.node.node_table import PATCH, Row, reads, writes
from tests.node.rows_pdo import ALL, COMMAND, TPDO1, ask, note_writes, only_tpdo1, rpdo, sample, tell, wanted

LATE = "<- 080+n 00 81 11 07 10 00 00 00"
IN_TIME = "<- 080+n 00 00 00 00 81 07 10 00"


def late(ms, data=b""):
    """A SYNC that the device comes to only so long after it was on the wire."""

    def act(bench):
        t_ns = bench.now_ns
        bench.now_ns += round(1e6 * ms)
        bench.step([Frame(0x080, data, t_ns)])

    act.on_bench = True
    return act


WINDOW_ROWS = [
    Row(
        "within the synchronous window TPDOs are sent",
        "301 7.5.2.7",
        [sample, *writes("1007:00", "10 27 00 00"), "++ 1", late(10), *ALL],
        state="op",
    ),
    Row(
        "after the synchronous window TPDOs are not sent",
        "301 7.5.2.7",
        [
            sample,
            *writes("1007:00", "10 27 00 00"),
            "++ 1",
            late(10.001),
            LATE,
            late(10.001),
            "-> 080",
            *ALL,
            IN_TIME,
        ],
        state="op",
    ),
    Row(
        "without a window a TPDO may be late",
        "301 7.5.2.7",
        [sample, "++ 1", late(30), *ALL],
        state="op",
    ),
    Row(
        "a window that is taken back is none",
        "301 7.5.2.7",
        [
            sample,
            *writes("1007:00", "10 27 00 00"),
            "++ 1",
            late(20),
            LATE,
            *writes("1007:00", "00 00 00 00"),
            late(20),
            *ALL,
            IN_TIME,
        ],
        state="op",
    ),
    Row(
        "a SYNC outside the window is counted",
        "301 7.5.2.7",
        [only_tpdo1(2), *writes("1007:00", "E8 03 00 00"), "++ 1", late(2), LATE, "-> 080", TPDO1, IN_TIME],
        state="op",
    ),
    Row(
        "an event outside the window is not made up for",
        "301 7.5.2.7",
        [
            only_tpdo1(0),
            *writes("1007:00", "E8 03 00 00"),
            "++ 1",
            ask(1),
            late(2),
            LATE,
            "-> 080",
            IN_TIME,
        ],
        state="op",
    ),
    Row(
        "event-driven TPDOs have no window",
        "301 7.5.2.7",
        [only_tpdo1(254), *writes("1007:00", "E8 03 00 00"), "++ 1", late(2), ask(1), TPDO1],
        state="op",
    ),
    Row(
        "a synchronous RPDO after the window is dropped",
        "301 7.5.2.7",
        [
            rpdo(COMMAND, kind=1),
            only_tpdo1(254),
            *writes("1007:00", "E8 03 00 00"),
            note_writes,
            "-> 080",
            "++ 2",
            "-> 211 01 00 00 00",
            "-> 080",
            wanted(),
            "-> 211 02 00 00 00",
            "-> 080",
            wanted((0x2050, 0, 2)),
        ],
        state="op",
    ),
    Row(
        "a stopped device forgets the window",
        "301 7.5.2.7",
        [
            sample,
            *writes("1007:00", "E8 03 00 00"),
            "++ 1",
            late(2),
            LATE,
            "-> 000 02 nn",
            "-> 000 01 nn",
            "-> 080",
            *ALL,
            IN_TIME,
        ],
        state="op",
    ),
]

STAMP_ROWS = [
    Row(
        "the sample is stamped with the counter of its SYNC",
        "skinbus 0x2070",
        [
            tell(0x1019, 0, 240),
            only_tpdo1(1),
            "-> 080 07",
            TPDO1,
            *reads("2070:01", "07"),
            *reads("2070:02", "00"),
        ],
        state="op",
    ),
    Row(
        "a SYNC without counter leaves no counter",
        "skinbus 0x2070",
        [only_tpdo1(1), "-> 080", TPDO1, *reads("2070:01", "00"), *reads("2070:02", "00")],
        state="op",
    ),
    Row(
        "an error is in the stamp",
        "skinbus 0x2070",
        [
            only_tpdo1(1),
            lambda device: device.emcy(0x5000),
            "<- 080+n 00 50 01 00 00 00 00 00",
            "-> 080",
            TPDO1,
            *reads("2070:02", "04"),
        ],
        state="op",
    ),
    Row(
        "an old sample is of no SYNC",
        "skinbus 0x2070",
        [
            tell(0x1019, 0, 240),
            only_tpdo1(1),
            lambda device: setattr(device, "sample_status", SampleStatus.OLD),
            "-> 080 07",
            TPDO1,
            *reads("2070:01", "00"),
            *reads("2070:02", "01"),
        ],
        state="op",
    ),
]

ROWS = [Row(r.name, r.section, r.steps, r.state, PATCH) for r in (*WINDOW_ROWS, *STAMP_ROWS)]
