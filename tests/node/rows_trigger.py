"""Conformance rows: analogue inputs that are sent because they changed (CiA 401)."""

from tests.node.node_table import PATCH, Row, writes

ENABLE = writes("6423:00", "01")
ZERO = "00 00 00 00 00 00 00 00"
FIRST = f"<- 180+n {ZERO}"
DEFAULT = 0x07  # upper limit, lower limit, delta


def event_driven(kind=254, inhibit=0, event=0, trigger=DEFAULT, upper=0, lower=0, delta=0, **more):
    """TPDO 1 alone, on events; the same selection on every input."""

    def act(device):
        for number in (2, 3, 4):
            device.set(0x17FF + number, 1, 0xC0000000)
        device.set(0x1800, 2, kind)
        device.set(0x1800, 3, inhibit)
        device.set(0x1800, 5, event)
        for sub in range(1, 17):
            device.set(0x6421, sub, trigger)
            device.set(0x6424, sub, upper)
            device.set(0x6425, sub, lower)
            device.set(0x6426, sub, delta)
        device.step(0)

    return act


def reading(*values):
    """The first inputs as the patch samples them."""

    def act(device):
        device.image_view(0x6401, 1, len(values))[:] = values

    return act


START = "-> 000 01 nn"

ROWS = [
    Row("no events while they are not enabled", "401 6423h", [event_driven(), START, reading(100), "++ 100"]),
    Row(
        "enabled, what was never told is told", "401 6423h", [event_driven(), *ENABLE, START, FIRST, "++ 100"]
    ),
    Row(
        "a change is told",
        "401 6423h",
        [event_driven(), *ENABLE, START, FIRST, reading(1), "<- 180+n 01 00 00 00 00 00 00 00", "++ 100"],
    ),
    Row(
        "no change, no PDO",
        "401 6426h",
        [event_driven(), *ENABLE, START, FIRST, reading(0), reading(0), "++ 1000"],
    ),
    Row(
        "a change of another PDO's inputs",
        "401 6423h",
        [event_driven(), *ENABLE, START, FIRST, reading(0, 0, 0, 0, 9), "++ 100"],
    ),
    Row(
        "not more than delta",
        "401 6426h",
        [event_driven(delta=10), *ENABLE, START, FIRST, reading(10), reading(-10), "++ 100"],
    ),
    Row(
        "more than delta",
        "401 6426h",
        [event_driven(delta=10), *ENABLE, START, FIRST, reading(11), "<- 180+n 0B 00 00 00 00 00 00 00"],
    ),
    Row(
        "delta counts from what was told",
        "401 6426h",
        [
            event_driven(delta=10),
            *ENABLE,
            START,
            FIRST,
            reading(6),
            reading(11),
            "<- 180+n 0B 00 00 00 00 00 00 00",
            reading(2),
            reading(1),
            reading(0),
            "<- 180+n 00 00 00 00 00 00 00 00",
        ],
    ),
    Row(
        "delta downwards",
        "401 6426h",
        [event_driven(delta=10), *ENABLE, START, FIRST, reading(0, -11), "<- 180+n 00 00 F5 FF 00 00 00 00"],
    ),
    Row(
        "delta over the whole range",
        "401 6426h",
        [
            event_driven(delta=65534),
            *ENABLE,
            reading(-32768),
            START,
            "<- 180+n 00 80 00 00 00 00 00 00",
            reading(32767),
            "<- 180+n FF 7F 00 00 00 00 00 00",
        ],
    ),
    Row(
        "at the upper limit",
        "401 6424h",
        [
            event_driven(trigger=1, upper=100),
            *ENABLE,
            START,
            "++ 10",
            reading(99),
            reading(100),
            "<- 180+n 64 00 00 00 00 00 00 00",
        ],
    ),
    Row(
        "above the upper limit every change is told",
        "401 6424h",
        [
            event_driven(trigger=1, upper=100),
            *ENABLE,
            START,
            reading(200),
            "<- 180+n C8 00 00 00 00 00 00 00",
            reading(201),
            "<- 180+n C9 00 00 00 00 00 00 00",
            "++ 10",
        ],
    ),
    Row(
        "above the upper limit delta decides",
        "401 6424h",
        [
            event_driven(trigger=5, upper=100, delta=10),
            *ENABLE,
            START,
            reading(200),
            "<- 180+n C8 00 00 00 00 00 00 00",
            reading(205),
            reading(211),
            "<- 180+n D3 00 00 00 00 00 00 00",
            reading(50),
        ],
    ),
    Row(
        "below the lower limit",
        "401 6425h",
        [
            event_driven(trigger=2, lower=-100),
            *ENABLE,
            START,
            reading(-99),
            reading(-100),
            "<- 180+n 9C FF 00 00 00 00 00 00",
            "++ 10",
        ],
    ),
    Row(
        "both limits: what lies between is not reported",
        "401 6425h",
        [
            event_driven(trigger=3, upper=100, lower=-100),
            *ENABLE,
            START,
            reading(50),
            reading(-50),
            "++ 10",
            reading(-100),
            "<- 180+n 9C FF 00 00 00 00 00 00",
        ],
    ),
    Row(
        "no trigger selected", "401 6421h", [event_driven(trigger=0), *ENABLE, START, reading(5000), "++ 100"]
    ),
    Row(
        "the inhibit time holds for changes",
        "401 6423h",
        [
            event_driven(inhibit=100),
            *ENABLE,
            START,
            FIRST,
            reading(1),
            reading(2),
            "++ 10",
            "<- 180+n 02 00 00 00 00 00 00 00",
            "++ 100",
        ],
    ),
    Row(
        "the event timer tells without a change",
        "401 6423h",
        [event_driven(event=50), *ENABLE, START, FIRST, "++ 50", FIRST, "++ 50", FIRST],
    ),
    Row(
        "type 0 waits for SYNC",
        "401 6423h",
        [
            event_driven(kind=0),
            *ENABLE,
            START,
            reading(1),
            "-> 080",
            "<- 180+n 01 00 00 00 00 00 00 00",
            "-> 080",
            reading(2),
            "-> 080",
            "<- 180+n 02 00 00 00 00 00 00 00",
        ],
    ),
    Row("type 1 is not asked", "401 6423h", [event_driven(kind=1), *ENABLE, START, reading(1), "++ 10"]),
    Row(
        "enabled while operational",
        "401 6423h",
        [event_driven(), START, reading(1), *ENABLE, "<- 180+n 01 00 00 00 00 00 00 00"],
    ),
    Row(
        "disabled again",
        "401 6423h",
        [event_driven(), *ENABLE, START, FIRST, *writes("6423:00", "00"), reading(1), "++ 10"],
    ),
    Row("nothing in pre-operational", "401 6423h", [event_driven(), *ENABLE, reading(1), "++ 10"]),
    Row(
        "a new delta counts at once",
        "401 6426h",
        [
            event_driven(delta=100),
            *ENABLE,
            START,
            FIRST,
            reading(50),
            *writes("6426:01", "31 00 00 00"),
            "<- 180+n 32 00 00 00 00 00 00 00",
        ],
    ),
]
ROWS = [Row(r.name, r.section, r.steps, r.state, PATCH) for r in ROWS]
