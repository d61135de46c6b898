"""Conformance rows: what may be written to the parameters of a PDO, and when."""

from tests.node.node_table import PATCH, Row, done, refuses, writes
from tests.node.rows_pdo import ALL, NEXT, TPDO1, sample

OFF = ["-> 600+n 23 00 18 01 85 01 00 C0 ; TPDO 1 invalid", done("1800:01")]
ON = ["-> 600+n 23 00 18 01 85 01 00 40 ; TPDO 1 valid", done("1800:01")]

RULE_ROWS = [
    Row("a PDO is made invalid and is silent", "301 7.5.2.37", [sample, *OFF, "-> 080", *NEXT], state="op"),
    Row("a PDO is made valid again", "301 7.5.2.37", [sample, *OFF, *ON, "-> 080", *ALL], state="op"),
    Row(
        "a PDO gets another identifier",
        "301 7.5.2.37",
        [
            sample,
            *OFF,
            *writes("1800:01", "8A 01 00 40"),
            "-> 080",
            "<- 18A 34 12 FE FF 03 00 FF 7F",
            *NEXT,
        ],
        state="op",
    ),
    Row("the identifier of a valid PDO stays", "301 7.5.2.37", refuses("1800:01", "8A 01 00 40", 0x06090030)),
    Row("no extended identifiers", "301 7.5.2.37", [*OFF, *refuses("1800:01", "8A 01 00 60", 0x06090030)]),
    Row("no PDO on remote frames", "301 7.5.2.37", refuses("1800:01", "85 01 00 00", 0x06090030)),
    Row(
        "no PDO on the identifier of NMT", "301 7.3.5", [*OFF, *refuses("1800:01", "00 00 00 40", 0x06090030)]
    ),
    Row(
        "no PDO on the identifier of an SDO",
        "301 7.3.5",
        [*OFF, *refuses("1800:01", "01 06 00 40", 0x06090030)],
    ),
    Row("no PDO on a heartbeat", "301 7.3.5", [*OFF, *refuses("1800:01", "05 07 00 40", 0x06090030)]),
    Row("reserved transmission types", "301 7.5.2.37", refuses("1800:02", "F1", 0x06090030)),
    Row("no transmission on remote frames", "301 7.5.2.37", refuses("1800:02", "FC", 0x06090030)),
    Row(
        "the transmission type changes at once",
        "301 7.5.2.37",
        [sample, *writes("1800:02", "02"), "-> 080", *NEXT, "-> 080", *NEXT, TPDO1],
        state="op",
    ),
    Row("the inhibit time of a valid PDO stays", "301 7.5.2.37", refuses("1800:03", "64 00", 0x06010000)),
    Row("the inhibit time of an invalid PDO", "301 7.5.2.37", [*OFF, *writes("1800:03", "64 00"), *ON]),
    Row("the start value of a valid PDO stays", "301 7.5.2.37", refuses("1800:06", "05", 0x06010000)),
    Row("the start value has a limit", "301 7.5.2.37", [*OFF, *refuses("1800:06", "F1", 0x06090031)]),
    Row("the event timer may change", "301 7.5.2.37", writes("1800:05", "64 00")),
    Row("no mapping while the PDO is valid", "301 7.5.2.38", refuses("1A00:00", "00", 0x06010000)),
    Row(
        "no entry while the mapping is in force",
        "301 7.5.2.38",
        [*OFF, *refuses("1A00:01", "10 05 01 64", 0x06010000)],
    ),
    Row(
        "mapping at run time",
        "301 7.5.2.38",
        [
            sample,
            *OFF,
            *writes("1A00:00", "00"),
            *writes("1A00:01", "10 04 01 64"),
            *writes("1A00:02", "08 00 01 10"),
            *writes("1A00:03", "10 01 01 64"),
            *writes("1A00:00", "03"),
            *ON,
            "-> 080",
            "<- 180+n FF 7F 00 34 12",
            *NEXT,
        ],
        state="op",
    ),
    Row(
        "an object that is not there",
        "301 7.5.2.38",
        [*OFF, *writes("1A00:00", "00"), *refuses("1A00:01", "10 00 FF 5F", 0x06020000)],
    ),
    Row(
        "an object that cannot be mapped",
        "301 7.5.2.38",
        [*OFF, *writes("1A00:00", "00"), *refuses("1A00:01", "20 00 00 10", 0x06040041)],
    ),
    Row(
        "an object of another length",
        "301 7.5.2.38",
        [*OFF, *writes("1A00:00", "00"), *refuses("1A00:01", "08 01 01 64", 0x06040041)],
    ),
    Row(
        "what can only be written cannot be sent",
        "301 7.5.2.38",
        [*OFF, *writes("1A00:00", "00"), *refuses("1A00:01", "20 00 50 20", 0x06040041)],
    ),
    Row(
        "a dummy cannot be sent",
        "301 7.4.7.1",
        [*OFF, *writes("1A00:00", "00"), *refuses("1A00:01", "08 00 05 00", 0x06020000)],
    ),
    Row(
        "more than eight bytes",
        "301 7.5.2.38",
        [
            *OFF,
            *writes("1A00:00", "00"),
            *writes("1A00:05", "10 05 01 64"),
            *refuses("1A00:00", "05", 0x06040042),
            *writes("1A00:00", "04"),
        ],
    ),
    Row(
        "more entries than there are",
        "301 7.5.2.38",
        [*OFF, *writes("1A00:00", "00"), *refuses("1A00:00", "08", 0x06020000)],
    ),
    Row(
        "a count beyond the limit",
        "301 7.5.2.38",
        [*OFF, *writes("1A00:00", "00"), *refuses("1A00:00", "09", 0x06090031)],
    ),
    Row(
        "a cleared entry",
        "301 7.5.2.38",
        [
            *OFF,
            *writes("1A00:00", "00"),
            *writes("1A00:04", "00 00 00 00"),
            *refuses("1A00:00", "04", 0x06020000),
        ],
    ),
    Row(
        "a PDO without objects is not sent",
        "301 7.5.2.38",
        [sample, *OFF, *writes("1A00:00", "00"), *ON, "-> 080", *NEXT],
        state="op",
    ),
    Row("an RPDO of a reserved identifier", "301 7.3.5", refuses("1400:01", "01 06 00 00", 0x06090030)),
    Row(
        "an RPDO cannot write what is read-only",
        "301 7.5.2.36",
        [*writes("1600:00", "00"), *refuses("1600:01", "10 01 01 64", 0x06040041)],
    ),
]
ROWS = [Row(r.name, r.section, r.steps, r.state, PATCH) for r in RULE_ROWS]
