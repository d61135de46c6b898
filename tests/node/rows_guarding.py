"""Conformance rows: node guarding and life guarding."""

from tests.node.node_table import MASTER, PATCH, Row, reads, writes
from tests.node.rows_pdo import tell

LIFE = [*writes("100C:00", "64 00"), *writes("100D:00", "03")]
LOST = "<- 080+n 30 81 11 00 00 00 00 00"
BACK = "<- 080+n 00 00 00 30 81 00 00 00"

ROWS = [
    Row(
        "guarding is answered with the state and a bit that toggles",
        "301 7.2.8.3.2.1",
        ["=> 700+n", "<- 700+n 7F", "=> 700+n", "<- 700+n FF", "=> 700+n", "<- 700+n 7F"],
        on=PATCH,
    ),
    Row(
        "guarding reports each state",
        "301 7.2.8.3.2.1",
        ["=> 700+n", "<- 700+n 05", "-> 000 02 nn", "=> 700+n", "<- 700+n 84"],
        state="op",
        on=PATCH,
    ),
    Row(
        "after a boot the bit is cleared",
        "301 7.2.8.3.2.1",
        [
            "=> 700+n",
            "<- 700+n 7F",
            "-> 000 82 nn",
            "<- 700+n 00",
            tell(0x1017, 0, 0),
            "=> 700+n",
            "<- 700+n 7F",
        ],
        on=PATCH,
    ),
    Row(
        "a node with a heartbeat is not guarded",
        "301 7.2.8.2.2",
        [tell(0x1017, 0, 100), "<- 700+n 7F", "=> 700+n", "++ 99", "++ 1", "<- 700+n 7F"],
        on=PATCH,
    ),
    Row("the guarding of another node", "301 7.2.8.3.2.1", ["=> 733"], on=PATCH),
    Row("no life time before the first guarding", "301 7.2.8.2.2", [*LIFE, "++ 5000"], on=PATCH),
    Row(
        "a master that no longer guards is reported once",
        "301 7.2.8.2.2",
        [*LIFE, "=> 700+n", "<- 700+n 7F", "++ 299", "++ 1", LOST, "++ 5000", *reads("1001:00", "11")],
        on=PATCH,
    ),
    Row(
        "a master that guards again ends the error",
        "301 7.2.8.2.2",
        [*LIFE, "=> 700+n", "<- 700+n 7F", "++ 300", LOST, "=> 700+n", "<- 700+n FF", BACK],
        on=PATCH,
    ),
    Row(
        "each guarding begins the life time anew",
        "301 7.2.8.2.2",
        [*LIFE, "=> 700+n", "<- 700+n 7F", "++ 299", "=> 700+n", "<- 700+n FF", "++ 299", "++ 1", LOST],
        on=PATCH,
    ),
    Row(
        "lost guarding takes a node out of operational",
        "301 7.5.2.28",
        [
            *LIFE,
            "=> 700+n",
            "<- 700+n 05",
            "++ 300",
            LOST,
            "=> 700+n",
            "<- 700+n FF",
            BACK,
        ],
        state="op",
        on=PATCH,
    ),
    Row(
        "without a life time nothing is watched",
        "301 7.2.8.2.2",
        [*LIFE, "=> 700+n", "<- 700+n 7F", *writes("100D:00", "00"), "++ 5000"],
        on=PATCH,
    ),
    Row("a remote frame with another identifier is no guarding", "301 7.2.8.3.2.1", ["=> 580+n", "=> 600+n"]),
    Row("the master is not guarded", "301 7.2.8.2.2", ["=> 700+n"], on=MASTER),
]
