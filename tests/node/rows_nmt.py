"""Conformance rows: NMT states, boot-up, heartbeat, and what each state sends and answers."""

from skinbus.objects.cia import HEARTBEAT_PRODUCER, NmtCommand
from tests.node.node_table import PATCH, Row

READ_TYPE = "-> 600+n 40 01 10 00 00 00 00 00 ; read the error register"
TYPE_IS = "<- 580+n 4F 01 10 00 00 00 00 00"
SYNC = "-> 080"
READINGS = [
    "<- 180+n 00 00 00 00 00 00 00 00",
    "<- 280+n 00 00 00 00 00 00 00 00",
    "<- 380+n 00 00 00 00 00 00 00 00",
    "<- 480+n 00 00 00 00 00 00 00 00",
]


def beat(ms: int):
    return lambda device: device.set(HEARTBEAT_PRODUCER, 0, ms)


ROWS = [
    Row("boot-up is the first frame", "301 7.3.2.2.1", [lambda d: None, "<- 700+n 00"], state="off"),
    Row("a booted node answers SDO", "301 7.3.2.2.5", [READ_TYPE, TYPE_IS]),
    Row(
        "start for this node",
        "301 7.2.8.3.1.1",
        [beat(100), "<- 700+n 7F", "-> 000 01 nn", "++ 100", "<- 700+n 05"],
    ),
    Row(
        "start for all nodes",
        "301 7.2.8.3.1.1",
        [beat(100), "<- 700+n 7F", "-> 000 01 00", "++ 100", "<- 700+n 05"],
    ),
    Row(
        "start for another node is not for us",
        "301 7.2.8.3.1.1",
        [beat(100), "<- 700+n 7F", "-> 000 01 33", "++ 100", "<- 700+n 7F"],
    ),
    Row(
        "stop",
        "301 7.2.8.3.1.2",
        [beat(100), "<- 700+n 05", "-> 000 02 nn", "++ 100", "<- 700+n 04"],
        state="op",
    ),
    Row(
        "enter pre-operational",
        "301 7.2.8.3.1.3",
        [beat(100), "<- 700+n 05", "-> 000 80 nn", "++ 100", "<- 700+n 7F"],
        state="op",
    ),
    Row("reset node boots up again", "301 7.2.8.3.1.4", ["-> 000 81 nn", "<- 700+n 00"], state="op"),
    Row("reset communication boots up again", "301 7.2.8.3.1.5", ["-> 000 82 nn", "<- 700+n 00"], state="op"),
    Row("reset node for all", "301 7.2.8.3.1.4", ["-> 000 81 00", "<- 700+n 00"], state="stopped"),
    Row("a stopped node can be reset", "301 7.3.2.2", ["-> 000 82 nn", "<- 700+n 00"], state="stopped"),
    Row(
        "a stopped node can be started",
        "301 7.3.2.2",
        ["-> 000 01 nn", READ_TYPE, TYPE_IS],
        state="stopped",
    ),
    Row("an unknown command changes nothing", "301 7.2.8.3.1", ["-> 000 03 nn", READ_TYPE, TYPE_IS]),
    Row("a command of one byte changes nothing", "301 7.2.8.3.1", ["-> 000 02", READ_TYPE, TYPE_IS]),
    Row("a command of three bytes changes nothing", "301 7.2.8.3.1", ["-> 000 02 nn 00", READ_TYPE, TYPE_IS]),
    Row("an empty command changes nothing", "301 7.2.8.3.1", ["-> 000", READ_TYPE, TYPE_IS]),
    Row("a stopped node is silent to SDO", "301 7.3.2.2.5", [READ_TYPE, "-- 600+n"], state="stopped"),
    Row(
        "a stopped node keeps its heartbeat",
        "301 7.2.8.3.2.2",
        [beat(100), "<- 700+n 04", "++ 100", "<- 700+n 04"],
        state="stopped",
    ),
    Row("SYNC in pre-operational brings no PDO", "301 7.3.2.2.5", [SYNC], on=PATCH),
    Row("SYNC in stopped is not heard", "301 7.3.2.2.5", [SYNC, "-- 080"], state="stopped"),
    Row("SYNC in operational brings the readings", "301 7.3.2.2.5", [SYNC, *READINGS], state="op", on=PATCH),
    Row(
        "operational, pre-operational, no PDO",
        "301 7.3.2.2.5",
        ["-> 000 80 00", SYNC, "-> 000 01 00", "-> 080", *READINGS],
        state="op",
        on=PATCH,
    ),
    Row("an operational node answers SDO", "301 7.3.2.2.5", [READ_TYPE, TYPE_IS], state="op"),
    Row(
        "heartbeat at its period",
        "301 7.2.8.3.2.2",
        [beat(50), "<- 700+n 7F", "++ 49", "++ 1", "<- 700+n 7F", "++ 50", "<- 700+n 7F"],
    ),
    Row(
        "heartbeat by SDO, at once",
        "301 7.5.2.19",
        [
            "-> 600+n 2B 17 10 00 0A 00 00 00",
            "<- 580+n 60 17 10 00 00 00 00 00",
            "<- 700+n 7F",
            "++ 10",
            "<- 700+n 7F",
            "-> 600+n 2B 17 10 00 00 00 00 00",
            "<- 580+n 60 17 10 00 00 00 00 00",
            "++ 100",
        ],
    ),
    Row("no heartbeat when the time is 0", "301 7.5.2.19", ["++ 5000"]),
    Row(
        "a remote frame for the heartbeat is not answered",
        "301 7.2.8.3.2.1",
        ["-> 700+n", "-- 700+n"],
    ),
    Row(
        "the host's own command",
        "301 7.3.2.2",
        [lambda d: d.command(NmtCommand.START), beat(100), "<- 700+n 05"],
    ),
]
