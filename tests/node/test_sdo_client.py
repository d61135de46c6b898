"""The SDO client, from bytes to bytes: each row is a whole transfer."""

import pytest

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.errors import LocalProtocolError, SdoAborted
from skinbus.node import SdoClient
from tests.node.node_table import Bench

READ, WRITE = "read", "write"

# name, what is started, frames sent (">") and received ("<") in order, data or abort code at the end
TRANSFERS = [
    (
        "expedited read",
        (READ, 0x1000, 0),
        ["> 40 00 10 00 00 00 00 00", "< 43 00 10 00 91 01 04 00"],
        b"\x91\x01\x04\x00",
    ),
    ("one byte", (READ, 0x1001, 0), ["> 40 01 10 00 00 00 00 00", "< 4F 01 10 00 05 00 00 00"], b"\x05"),
    (
        "size not given",
        (READ, 0x1001, 0),
        ["> 40 01 10 00 00 00 00 00", "< 42 01 10 00 05 06 07 08"],
        b"\x05\x06\x07\x08",
    ),
    (
        "segmented read",
        (READ, 0x1008, 0),
        [
            "> 40 08 10 00 00 00 00 00",
            "< 41 08 10 00 09 00 00 00",
            "> 60 00 00 00 00 00 00 00",
            "< 00 61 62 63 64 65 66 67",
            "> 70 00 00 00 00 00 00 00",
            "< 1B 68 69 00 00 00 00 00",
        ],
        b"abcdefghi",
    ),
    (
        "segmented read without size",
        (READ, 0x1008, 0),
        [
            "> 40 08 10 00 00 00 00 00",
            "< 40 08 10 00 00 00 00 00",
            "> 60 00 00 00 00 00 00 00",
            "< 0D 61 00 00 00 00 00 00",
        ],
        b"a",
    ),
    (
        "an empty read",
        (READ, 0x1008, 0),
        [
            "> 40 08 10 00 00 00 00 00",
            "< 41 08 10 00 00 00 00 00",
            "> 60 00 00 00 00 00 00 00",
            "< 0F 00 00 00 00 00 00 00",
        ],
        b"",
    ),
    (
        "expedited write",
        (WRITE, 0x1017, 0, b"\xf4\x01"),
        ["> 2B 17 10 00 F4 01 00 00", "< 60 17 10 00 00 00 00 00"],
        b"",
    ),
    (
        "segmented write",
        (WRITE, 0x1F22, 1, b"abcdefgh"),
        [
            "> 21 22 1F 01 08 00 00 00",
            "< 60 22 1F 01 00 00 00 00",
            "> 00 61 62 63 64 65 66 67",
            "< 20 00 00 00 00 00 00 00",
            "> 1D 68 00 00 00 00 00 00",
            "< 30 00 00 00 00 00 00 00",
        ],
        b"",
    ),
    (
        "an empty write",
        (WRITE, 0x1F22, 1, b""),
        [
            "> 21 22 1F 01 00 00 00 00",
            "< 60 22 1F 01 00 00 00 00",
            "> 0F 00 00 00 00 00 00 00",
            "< 20 00 00 00 00 00 00 00",
        ],
        b"",
    ),
    ("an abort", (READ, 0x5FFF, 0), ["> 40 FF 5F 00 00 00 00 00", "< 80 FF 5F 00 00 00 02 06"], 0x06020000),
    (
        "an abort in the middle",
        (READ, 0x1008, 0),
        [
            "> 40 08 10 00 00 00 00 00",
            "< 41 08 10 00 09 00 00 00",
            "> 60 00 00 00 00 00 00 00",
            "< 80 08 10 00 00 00 04 05",
        ],
        0x05040000,
    ),
    (
        "a toggle bit that does not alternate",
        (READ, 0x1008, 0),
        [
            "> 40 08 10 00 00 00 00 00",
            "< 41 08 10 00 09 00 00 00",
            "> 60 00 00 00 00 00 00 00",
            "< 10 61 62 63 64 65 66 67",
            "> 80 08 10 00 00 00 03 05",
        ],
        0x05030000,
    ),
    (
        "an answer to something else",
        (READ, 0x1000, 0),
        ["> 40 00 10 00 00 00 00 00", "< 60 00 10 00 00 00 00 00", "> 80 00 10 00 01 00 04 05"],
        0x05040001,
    ),
    (
        "more than announced",
        (READ, 0x1008, 0),
        [
            "> 40 08 10 00 00 00 00 00",
            "< 41 08 10 00 03 00 00 00",
            "> 60 00 00 00 00 00 00 00",
            "< 00 61 62 63 64 65 66 67",
            "> 80 08 10 00 10 00 07 06",
        ],
        0x06070010,
    ),
    (
        "less than announced",
        (READ, 0x1008, 0),
        [
            "> 40 08 10 00 00 00 00 00",
            "< 41 08 10 00 09 00 00 00",
            "> 60 00 00 00 00 00 00 00",
            "< 01 61 62 63 64 65 66 67",
            "> 80 08 10 00 10 00 07 06",
        ],
        0x06070010,
    ),
    (
        "the late answer of another object is let pass",
        (READ, 0x1000, 0),
        ["> 40 00 10 00 00 00 00 00", "< 4F 01 10 00 05 00 00 00", "< 43 00 10 00 01 02 03 04"],
        b"\x01\x02\x03\x04",
    ),
    (
        "a short answer is let pass",
        (READ, 0x1001, 0),
        ["> 40 01 10 00 00 00 00 00", "< 4F 01 10 00 05", "< 4F 01 10 00 06 00 00 00"],
        b"\x06",
    ),
]


@pytest.mark.parametrize(
    ("started", "frames", "end"), [t[1:] for t in TRANSFERS], ids=[t[0] for t in TRANSFERS]
)
def test_transfer_is_this_table(started, frames, end):
    client = SdoClient(5)
    kind, *arguments = started
    (client.start_read if kind == READ else client.start_write)(*arguments)
    sent = client.step(0)
    for text in frames:
        direction, _, data = text.partition(" ")
        if direction == ">":
            assert sent.pop(0) == Frame(0x605, bytes.fromhex(data), 0)
        else:
            assert not sent
            sent = client.step(0, [Frame(0x585, bytes.fromhex(data))])
    assert not sent
    assert not client.busy
    assert client.wake_ns == NEVER
    assert client.result is not None
    assert (client.result.data if isinstance(end, bytes) else client.result.abort) == end


def test_silence_ends_in_a_time_out():
    client = SdoClient(5, timeout_ns=1000)
    client.start_read(0x1000, 0)
    assert len(client.step(10)) == 1
    assert client.wake_ns == 1010
    assert client.step(1009) == []
    assert client.step(1010) == [Frame(0x605, bytes.fromhex("8000100000000405"), 1010)]
    with pytest.raises(SdoAborted) as caught:
        client.result.unwrap()
    assert caught.value.code == 0x05040000
    assert not client.result.remote


def test_other_frames_do_not_keep_it_waiting():
    client = SdoClient(5, timeout_ns=1000)
    client.start_read(0x1000, 0)
    client.step(0)
    client.step(900, [Frame(0x586, bytes(8)), Frame(0x585, bytes(8), flags=2)])
    assert client.step(1000)
    assert client.result.abort == 0x05040000


def test_one_transfer_at_a_time():
    client = SdoClient(5)
    client.start_read(0x1000, 0)
    with pytest.raises(LocalProtocolError):
        client.start_read(0x1001, 0)
    client.cancel()
    client.start_read(0x1001, 0)
    assert client.step(0)[0].data[1:4] == b"\x01\x10\x00"


@pytest.mark.parametrize("size", [1, 4, 5, 7, 8, 13, 14, 15, 200])
def test_client_and_server_of_ours_carry_any_length(size):
    bench = Bench("master")
    client = SdoClient(bench.node_id)
    data = bytes(i % 256 for i in range(size))
    frames: list[Frame] = []
    for start in (lambda: client.start_write(0x1F22, 7, data), lambda: client.start_read(0x1F22, 7)):
        start()
        while client.busy:
            frames = list(bench.device.step(0, client.step(0, frames)).frames)
    assert client.result.unwrap() == data
