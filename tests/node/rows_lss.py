"""Conformance rows: the LSS slave."""

from tests.node.node_table import MASTER, PATCH, Row

FREE = 255  # no node-ID yet

SWITCH_ON = "-> 7E5 04 01 00 00 00 00 00 00"
SWITCH_OFF = "-> 7E5 04 00 00 00 00 00 00 00"
ASK_NODE_ID = "-> 7E5 5E 00 00 00 00 00 00 00"
NODE_ID = "<- 7E4 5E nn 00 00 00 00 00 00"
# The patch: vendor "SKNB", product 0x5001, revision 0x00010000, serial 0x00C0FFEE.
SELECT = [
    "-> 7E5 40 42 4E 4B 53 00 00 00",
    "-> 7E5 41 01 50 00 00 00 00 00",
    "-> 7E5 42 00 00 01 00 00 00 00",
    "-> 7E5 43 EE FF C0 00 00 00 00",
]
SELECTED = "<- 7E4 44 00 00 00 00 00 00 00"
IDENTIFY = [
    "-> 7E5 46 42 4E 4B 53 00 00 00",
    "-> 7E5 47 01 50 00 00 00 00 00",
    "-> 7E5 48 00 00 00 00 00 00 00 ; revision from",
    "-> 7E5 49 FF FF 01 00 00 00 00 ; to",
    "-> 7E5 4A 00 00 C0 00 00 00 00 ; serial number from",
    "-> 7E5 4B FF FF C0 00 00 00 00 ; to",
]
IDENTIFIED = "<- 7E4 4F 00 00 00 00 00 00 00"
SCAN_ALL = "-> 7E5 51 00 00 00 00 80 00 00"


def set_node_id(byte: str) -> list[str]:
    return [f"-> 7E5 11 {byte} 00 00 00 00 00 00", "<- 7E4 11 00 00 00 00 00 00 00"]


def fastscan() -> list[str]:
    """The whole scan as a master does it: bits asked from the top, all answers those of the patch."""
    steps = [SCAN_ALL, IDENTIFIED]
    for part, number in enumerate((0x534B4E42, 0x5001, 0x10000, 0xC0FFEE)):
        known = 0
        for bit in range(31, -1, -1):
            steps.append(f"-> 7E5 51 {known.to_bytes(4, 'little').hex(' ')} {bit:02X} {part:02X} {part:02X}")
            if number >> bit & 1:
                known |= 1 << bit
            else:
                steps.append(IDENTIFIED)
        following = (part + 1) % 4
        steps.append(f"-> 7E5 51 {known.to_bytes(4, 'little').hex(' ')} 00 {part:02X} {following:02X}")
        steps.append(IDENTIFIED)
    return steps


def row(name, section, steps, **others):
    """A row for the patch: the EDS of the master says that it has no LSS."""
    return Row(name, section, steps, on=PATCH, **others)


ROWS = [
    Row("a device without LSS", "305 3.9.1", [SWITCH_ON, ASK_NODE_ID, SCAN_ALL], on=MASTER),
    row("switch all to configuration", "305 3.9.1", [SWITCH_ON, ASK_NODE_ID, NODE_ID]),
    row("a waiting node answers no inquiry", "305 3.9.1", [ASK_NODE_ID]),
    row("switch all back", "305 3.9.1", [SWITCH_ON, SWITCH_OFF, ASK_NODE_ID]),
    row("an unknown mode", "305 3.9.1", ["-> 7E5 04 02 00 00 00 00 00 00", ASK_NODE_ID]),
    row("switch one by its identity", "305 3.9.1", [*SELECT, SELECTED, ASK_NODE_ID, NODE_ID]),
    row("another serial number", "305 3.9.1", [*SELECT[:3], "-> 7E5 43 EF FF C0 00 00 00 00", ASK_NODE_ID]),
    row("another vendor", "305 3.9.1", ["-> 7E5 40 43 4E 4B 53 00 00 00", *SELECT[1:], ASK_NODE_ID]),
    row("a part of the identity is missing", "305 3.9.1", [*SELECT[:2], SELECT[3], ASK_NODE_ID]),
    row(
        "inquire vendor",
        "305 3.9.4",
        [SWITCH_ON, "-> 7E5 5A 00 00 00 00 00 00 00", "<- 7E4 5A 42 4E 4B 53 00 00 00"],
    ),
    row(
        "inquire product",
        "305 3.9.4",
        [SWITCH_ON, "-> 7E5 5B 00 00 00 00 00 00 00", "<- 7E4 5B 01 50 00 00 00 00 00"],
    ),
    row(
        "inquire revision",
        "305 3.9.4",
        [SWITCH_ON, "-> 7E5 5C 00 00 00 00 00 00 00", "<- 7E4 5C 00 00 01 00 00 00 00"],
    ),
    row(
        "inquire serial number",
        "305 3.9.4",
        [SWITCH_ON, "-> 7E5 5D 00 00 00 00 00 00 00", "<- 7E4 5D EE FF C0 00 00 00 00"],
    ),
    row(
        "a node-ID waits for the reset",
        "305 3.9.2",
        [SWITCH_ON, *set_node_id("21"), ASK_NODE_ID, NODE_ID, "-> 000 82 nn", "<- 721 00"],
    ),
    row(
        "the identifiers follow the node-ID",
        "305 3.9.2",
        [
            SWITCH_ON,
            *set_node_id("21"),
            "-> 000 82 nn",
            "<- 721 00",
            "-> 621 40 01 10 00 00 00 00 00",
            "<- 5A1 4F 01 10 00 00 00 00 00",
            "-> 621 40 14 10 00 00 00 00 00",
            "<- 5A1 43 14 10 00 A1 00 00 00",
        ],
    ),
    row(
        "node-ID 0 is none",
        "305 3.9.2",
        [SWITCH_ON, "-> 7E5 11 00 00 00 00 00 00 00", "<- 7E4 11 01 00 00 00 00 00 00"],
    ),
    row(
        "node-ID 128 is none",
        "305 3.9.2",
        [SWITCH_ON, "-> 7E5 11 80 00 00 00 00 00 00", "<- 7E4 11 01 00 00 00 00 00 00"],
    ),
    row(
        "a waiting node takes no node-ID",
        "305 3.9.2",
        ["-> 7E5 11 21 00 00 00 00 00 00", "-> 000 82 nn", "<- 700+n 00"],
    ),
    row(
        "node-ID 255 takes the node off the bus",
        "305 3.9.2",
        [SWITCH_ON, *set_node_id("FF"), "-> 000 82 nn", "++ 1000", "-- 600+n", SCAN_ALL, IDENTIFIED],
    ),
    row(
        "a bit rate of the table",
        "305 3.9.2",
        [SWITCH_ON, "-> 7E5 13 00 02 00 00 00 00 00", "<- 7E4 13 00 00 00 00 00 00 00"],
    ),
    row(
        "a bit rate the device has not",
        "305 3.9.2",
        [SWITCH_ON, "-> 7E5 13 00 08 00 00 00 00 00", "<- 7E4 13 01 00 00 00 00 00 00"],
    ),
    row(
        "the reserved bit rate",
        "305 3.9.2",
        [SWITCH_ON, "-> 7E5 13 00 05 00 00 00 00 00", "<- 7E4 13 01 00 00 00 00 00 00"],
    ),
    row(
        "a table of bit rates the device has not",
        "305 3.9.2",
        [SWITCH_ON, "-> 7E5 13 01 02 00 00 00 00 00", "<- 7E4 13 01 00 00 00 00 00 00"],
    ),
    row(
        "a bit rate is activated without an answer",
        "305 3.9.2",
        [
            SWITCH_ON,
            "-> 7E5 13 00 02 00 00 00 00 00",
            "<- 7E4 13 00 00 00 00 00 00 00",
            "-> 7E5 15 64 00 00 00 00 00 00",
        ],
    ),
    row(
        "a node-ID is stored",
        "305 3.9.3",
        [
            SWITCH_ON,
            *set_node_id("21"),
            "-> 7E5 17 00 00 00 00 00 00 00",
            "<- 7E4 17 00 00 00 00 00 00 00",
            "power",
            "<- 721 00",
            "-> 621 40 14 10 00 00 00 00 00 ; the identifier of EMCY",
            "<- 5A1 43 14 10 00 A1 00 00 00",
        ],
    ),
    row(
        "a node-ID that is not stored is forgotten",
        "305 3.9.3",
        [SWITCH_ON, *set_node_id("21"), "power", "<- 700+n 00"],
    ),
    row(
        "storing without a memory",
        "305 3.9.3",
        [SWITCH_ON, "-> 7E5 17 00 00 00 00 00 00 00", "<- 7E4 17 01 00 00 00 00 00 00"],
        storage=lambda: None,
    ),
    row("identify in a range", "305 3.9.5", [*IDENTIFY, IDENTIFIED]),
    row("outside the range", "305 3.9.5", [*IDENTIFY[:5], "-> 7E5 4B FE FE C0 00 00 00 00"]),
    row(
        "a range of another product",
        "305 3.9.5",
        [IDENTIFY[0], "-> 7E5 47 02 50 00 00 00 00 00", *IDENTIFY[2:]],
    ),
    row("a range that is not complete", "305 3.9.5", [*IDENTIFY[:3], *IDENTIFY[4:]]),
    row(
        "a configured node is not unconfigured",
        "305 3.9.5",
        ["-> 7E5 4C 00 00 00 00 00 00 00"],
    ),
    row(
        "an unconfigured node says so",
        "305 3.9.5",
        ["-> 7E5 4C 00 00 00 00 00 00 00", "<- 7E4 50 00 00 00 00 00 00 00"],
        node_id=FREE,
    ),
    row(
        "an unconfigured node is silent otherwise",
        "305 3.5",
        ["++ 5000", "-- 600+n", "-- 000", "-> 000 81 00", "-> 000 01 00", "++ 1000"],
        node_id=FREE,
    ),
    row("a configured node does not take part in a scan", "305 3.9.5", [SCAN_ALL]),
    row(
        "fastscan finds the node",
        "305 3.9.5",
        [*fastscan(), ASK_NODE_ID, "<- 7E4 5E FF 00 00 00 00 00 00"],
        node_id=FREE,
    ),
    row(
        "a scan for another identity",
        "305 3.9.5",
        [SCAN_ALL, IDENTIFIED, "-> 7E5 51 00 00 00 80 1F 00 00"],
        node_id=FREE,
    ),
    row(
        "a scan out of turn",
        "305 3.9.5",
        [SCAN_ALL, IDENTIFIED, "-> 7E5 51 00 00 00 00 1F 02 02"],
        node_id=FREE,
    ),
    row(
        "a scan with a bit that is none",
        "305 3.9.5",
        [SCAN_ALL, IDENTIFIED, "-> 7E5 51 00 00 00 00 20 00 00"],
        node_id=FREE,
    ),
    row(
        "an unconfigured node starts with its node-ID",
        "305 3.9.2",
        [
            *fastscan(),
            *set_node_id("21"),
            SWITCH_OFF,
            "<- 721 00",
            "-> 621 40 01 10 00 00 00 00 00",
            "<- 5A1 4F 01 10 00 00 00 00 00",
        ],
        node_id=FREE,
    ),
    row(
        "LSS of seven bytes is dropped",
        "305 3.9",
        ["-> 7E5 04 01 00 00 00 00 00", ASK_NODE_ID],
    ),
    row("an unknown LSS command", "305 3.9", [SWITCH_ON, "-> 7E5 99 00 00 00 00 00 00 00"]),
    row("LSS in stopped", "305 3.5", [SWITCH_ON, ASK_NODE_ID, NODE_ID], state="stopped"),
    row("no LSS in operational", "305 3.5", ["-- 7E5", SWITCH_ON, ASK_NODE_ID], state="op"),
]
