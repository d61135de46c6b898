"""Conformance rows: block transfers of SDO, up and down, and what goes wrong with them."""

from binascii import crc_hqx

from tests.node.node_table import MASTER, PATCH, Row, no, reads, up

NAME = b"skin master"
DOMAIN = bytes(range(1, 21))
"""Twenty bytes: three segments, of the last one byte unused."""


def crc(data):
    return crc_hqx(data, 0).to_bytes(2, "little").hex(" ").upper()


def line(*data):
    return " ".join(f"{byte:02X}" for byte in bytes(data).ljust(8, b"\0"))


def segments(data, first=1, last=True):
    """Segments as they are on the wire, numbered from ``first``."""
    chunks = [data[i : i + 7] for i in range(0, len(data), 7)]
    numbers = [first + k for k in range(len(chunks))]
    numbers[-1] |= 0x80 if last else 0
    return [line(number, *chunk) for number, chunk in zip(numbers, chunks, strict=True)]


def sent(lines):
    return [f"-> 600+n {text}" for text in lines]


def answered(lines):
    return [f"<- 580+n {text}" for text in lines]


ASK_NAME = "-> 600+n A4 08 10 00 7F 00 00 00"
NAME_COMES = "<- 580+n C6 08 10 00 0B 00 00 00"
BEGIN = "-> 600+n A3 00 00 00 00 00 00 00"
ALL_GOT = "-> 600+n A2 02 7F 00 00 00 00 00"
NAME_ENDS = f"<- 580+n CD {crc(NAME)} 00 00 00 00 00"
THANKS = "-> 600+n A1 00 00 00 00 00 00 00"
ASK_DOWN = "-> 600+n C6 22 1F 01 14 00 00 00 ; twenty bytes for node 1's concise DCF, with CRC"
GO_AHEAD = "<- 580+n A4 22 1F 01 7F 00 00 00"
END = f"-> 600+n C5 {crc(DOMAIN)} 00 00 00 00 00"
ENDED = "<- 580+n A1 00 00 00 00 00 00 00"


def got(n):
    return f"<- 580+n A2 {n:02X} 7F 00 00 00 00 00"


def read_back(data):
    """The domain, read in segments of the other kind."""
    steps = [up("1F22:01"), f"<- 580+n 41 22 1F 01 {len(data):02X} 00 00 00"]
    for k, start in enumerate(range(0, len(data), 7)):
        chunk, toggle = data[start : start + 7], 0x10 * (k % 2)
        command = toggle | (7 - len(chunk)) << 1 | (start + 7 >= len(data))
        steps += [f"-> 600+n {line(0x60 | toggle)}", f"<- 580+n {line(command, *chunk)}"]
    return steps


UP_ROWS = [
    Row(
        "block upload",
        "301 7.2.4.3.13",
        [ASK_NAME, NAME_COMES, BEGIN, *answered(segments(NAME)), ALL_GOT, NAME_ENDS, THANKS],
        on=MASTER,
    ),
    Row(
        "block upload without a checksum",
        "301 7.2.4.3.13",
        [
            "-> 600+n A0 08 10 00 7F 00 00 00",
            NAME_COMES,
            BEGIN,
            *answered(segments(NAME)),
            ALL_GOT,
            "<- 580+n CD 00 00 00 00 00 00 00",
            THANKS,
        ],
        on=MASTER,
    ),
    Row(
        "block upload in blocks of one segment",
        "301 7.2.4.3.14",
        [
            "-> 600+n A4 08 10 00 01 00 00 00",
            NAME_COMES,
            BEGIN,
            *answered(segments(NAME[:7], last=False)),
            "-> 600+n A2 01 01 00 00 00 00 00",
            *answered(segments(NAME[7:])),
            "-> 600+n A2 01 01 00 00 00 00 00",
            NAME_ENDS,
            THANKS,
        ],
        on=MASTER,
    ),
    Row(
        "a segment that was lost is sent again",
        "301 7.2.4.3.14",
        [
            ASK_NAME,
            NAME_COMES,
            BEGIN,
            *answered(segments(NAME)),
            "-> 600+n A2 01 7F 00 00 00 00 00",
            *answered(segments(NAME[7:])),
            "-> 600+n A2 01 7F 00 00 00 00 00",
            NAME_ENDS,
            THANKS,
        ],
        on=MASTER,
    ),
    Row(
        "a block that was lost is sent again",
        "301 7.2.4.3.14",
        [
            ASK_NAME,
            NAME_COMES,
            BEGIN,
            *answered(segments(NAME)),
            "-> 600+n A2 00 7F 00 00 00 00 00",
            *answered(segments(NAME)),
            ALL_GOT,
            NAME_ENDS,
            THANKS,
        ],
        on=MASTER,
    ),
    Row(
        "what is shorter than the threshold is uploaded in the usual way",
        "301 7.2.4.3.13",
        ["-> 600+n A4 01 10 00 7F 04 00 00", "<- 580+n 4F 01 10 00 00 00 00 00"],
    ),
    Row(
        "a long block goes out in bursts",
        "301 7.2.4.3.14",
        [
            lambda d: d.set(0x1F22, 1, bytes(range(70))),
            "-> 600+n A4 22 1F 01 7F 00 00 00",
            "<- 580+n C6 22 1F 01 46 00 00 00",
            BEGIN,
            *answered(segments(bytes(range(28)), last=False)),
            "++ 1",
            *answered(segments(bytes(range(28, 56)), first=5, last=False)),
            "++ 1",
            *answered(segments(bytes(range(56, 70)), first=9)),
            "-> 600+n A2 0A 7F 00 00 00 00 00",
            f"<- 580+n C1 {crc(bytes(range(70)))} 00 00 00 00 00",
            THANKS,
        ],
        on=MASTER,
    ),
    Row(
        "a block of no segments",
        "301 7.2.4.3.17",
        ["-> 600+n A4 08 10 00 00 00 00 00", no("1008:00", 0x05040002)],
    ),
    Row("a block of 128", "301 7.2.4.3.17", ["-> 600+n A4 08 10 00 80 00 00 00", no("1008:00", 0x05040002)]),
    Row(
        "the next block of no segments",
        "301 7.2.4.3.17",
        [
            ASK_NAME,
            NAME_COMES,
            BEGIN,
            *answered(segments(NAME)),
            "-> 600+n A2 01 00 00 00 00 00 00",
            no("1008:00", 0x05040002),
        ],
        on=MASTER,
    ),
    Row(
        "more segments got than were sent",
        "301 7.2.4.3.17",
        [
            ASK_NAME,
            NAME_COMES,
            BEGIN,
            *answered(segments(NAME)),
            "-> 600+n A2 03 7F 00 00 00 00 00",
            no("1008:00", 0x05040003),
        ],
        on=MASTER,
    ),
    Row(
        "no block of what is not there",
        "301 7.2.4.3.17",
        ["-> 600+n A4 FF 5F 00 7F 00 00 00", no("5FFF:00", 0x06020000)],
    ),
    Row(
        "no block of what can only be written",
        "301 7.2.4.3.17",
        ["-> 600+n A4 50 20 00 7F 00 00 00", no("2050:00", 0x06010001)],
        on=PATCH,
    ),
    Row("a step of an upload nobody asked for", "301 7.2.4.3.17", [BEGIN, no("0000:00", 0x05040001)]),
    Row(
        "a step of an upload out of turn",
        "301 7.2.4.3.17",
        [ASK_NAME, NAME_COMES, ALL_GOT, no("1008:00", 0x05040001), *reads("1001:00", "00")],
        on=MASTER,
    ),
    Row(
        "a client that falls silent in a block",
        "301 7.2.4.3.17",
        [
            ASK_NAME,
            NAME_COMES,
            BEGIN,
            *answered(segments(NAME)),
            "++ 999",
            "++ 1",
            no("1008:00", 0x05040000),
            "++ 3000",
        ],
        on=MASTER,
    ),
    Row(
        "a client aborts a block",
        "301 7.2.4.3.17",
        [ASK_NAME, NAME_COMES, "-> 600+n 80 08 10 00 00 00 04 05", "++ 3000", *reads("1001:00", "00")],
        on=MASTER,
    ),
]

DOWN_ROWS = [
    Row(
        "block download",
        "301 7.2.4.3.9",
        [ASK_DOWN, GO_AHEAD, *sent(segments(DOMAIN)), got(3), END, ENDED, *read_back(DOMAIN)],
        on=MASTER,
    ),
    Row(
        "block download without size and checksum",
        "301 7.2.4.3.9",
        [
            "-> 600+n C0 22 1F 01 00 00 00 00",
            GO_AHEAD,
            *sent(segments(DOMAIN)),
            got(3),
            "-> 600+n C5 00 00 00 00 00 00 00",
            ENDED,
            *read_back(DOMAIN),
        ],
        on=MASTER,
    ),
    Row(
        "block download of a number",
        "301 7.2.4.3.9",
        [
            "-> 600+n C6 15 10 00 02 00 00 00",
            "<- 580+n A4 15 10 00 7F 00 00 00",
            "-> 600+n 81 2C 01 00 00 00 00 00",
            got(1),
            f"-> 600+n D5 {crc(bytes((0x2C, 1)))} 00 00 00 00 00",
            ENDED,
            *reads("1015:00", "2C 01"),
        ],
    ),
    Row(
        "a segment that is missing, and all after it, come again",
        "301 7.2.4.3.10",
        [
            ASK_DOWN,
            GO_AHEAD,
            *[step for i, step in enumerate(sent(segments(DOMAIN))) if i != 1],
            got(1),
            *sent(segments(DOMAIN[7:])),
            got(2),
            END,
            ENDED,
            *read_back(DOMAIN),
        ],
        on=MASTER,
    ),
    Row(
        "a wrong checksum",
        "301 7.2.4.3.16",
        [
            ASK_DOWN,
            GO_AHEAD,
            *sent(segments(DOMAIN)),
            got(3),
            "-> 600+n C5 12 34 00 00 00 00 00",
            no("1F22:01", 0x05040004),
            up("1F22:01"),
            no("1F22:01", 0x08000024),
        ],
        on=MASTER,
    ),
    Row(
        "fewer bytes in blocks than announced",
        "301 7.2.4.3.17",
        [
            ASK_DOWN,
            GO_AHEAD,
            *sent(segments(DOMAIN[:14])),
            got(2),
            f"-> 600+n C1 {crc(DOMAIN[:14])} 00 00 00 00 00",
            no("1F22:01", 0x06070013),
        ],
        on=MASTER,
    ),
    Row(
        "more bytes in blocks than announced",
        "301 7.2.4.3.17",
        [
            "-> 600+n C6 22 1F 01 05 00 00 00",
            GO_AHEAD,
            *sent(segments(DOMAIN)),
            got(3),
            END,
            no("1F22:01", 0x06070012),
        ],
        on=MASTER,
    ),
    Row(
        "a segment without a number",
        "301 7.2.4.3.17",
        [ASK_DOWN, GO_AHEAD, "-> 600+n 00 01 02 03 04 05 06 07", no("1F22:01", 0x05040003)],
        on=MASTER,
    ),
    Row(
        "a client aborts a block download",
        "301 7.2.4.3.17",
        [ASK_DOWN, GO_AHEAD, "-> 600+n 80 22 1F 01 00 00 04 05", *reads("1001:00", "00")],
        on=MASTER,
    ),
    Row(
        "a client that falls silent in a block download",
        "301 7.2.4.3.17",
        [ASK_DOWN, GO_AHEAD, *sent(segments(DOMAIN)[:1]), "++ 999", "++ 1", no("1F22:01", 0x05040000)],
        on=MASTER,
    ),
    Row(
        "no block to what is read-only",
        "301 7.2.4.3.17",
        ["-> 600+n C6 08 10 00 0A 00 00 00", no("1008:00", 0x06010002)],
    ),
    Row(
        "no block too long for a number",
        "301 7.2.4.3.17",
        ["-> 600+n C6 15 10 00 0A 00 00 00", no("1015:00", 0x06070012)],
    ),
    Row("the end of a download nobody asked for", "301 7.2.4.3.17", [END, no("0000:00", 0x05040001)]),
    Row(
        "what comes in blocks is checked like any other",
        "301 7.2.4.3.17",
        [
            "-> 600+n C2 29 10 01 01 00 00 00",
            "<- 580+n A4 29 10 01 7F 00 00 00",
            "-> 600+n 81 03 00 00 00 00 00 00",
            got(1),
            "-> 600+n D9 00 00 00 00 00 00 00",
            no("1029:01", 0x06090031),
        ],
    ),
    Row(
        "stopping ends a block without a word",
        "301 7.3.2.2.5",
        [ASK_DOWN, GO_AHEAD, "-> 000 02 nn", "++ 2000", "-> 000 80 nn", *reads("1001:00", "00")],
        on=MASTER,
    ),
]

ROWS = [*UP_ROWS, *DOWN_ROWS]
