"""The SDO client, from bytes to bytes: each row is a whole transfer."""

from pathlib import Path

import pytest

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.errors import LocalProtocolError, SdoAborted
from skinbus.node import SdoClient

TRANSFERS = (Path(__file__).parent / "sdo_transfers.txt").read_text().split("\n# ")[1:]


@pytest.mark.parametrize("text", TRANSFERS, ids=lambda text: text.partition(" |")[0])
def test_transfer_is_this_table(text):
    client = SdoClient(5)
    head, *frames = text.strip().split("\n")
    _, started, end = (part.strip() for part in head.split("|"))
    kind, place, *data = started.split(maxsplit=2)
    index, sub = (int(number, 16) for number in place.split(":"))
    if kind == "read":
        client.start_read(index, sub)
    else:
        client.start_write(index, sub, bytes.fromhex("".join(data).removeprefix("=")))
    sent = client.step(0)
    for frame in frames:
        data = bytes.fromhex(frame[2:])
        if frame[0] == ">":
            assert sent.pop(0) == Frame(0x605, data, 0)
        else:
            assert not sent
            sent = client.step(0, [Frame(0x585, data)])
    assert not sent
    assert not client.busy
    assert client.wake_ns == NEVER
    if end.startswith("!"):
        assert client.result.abort == int(end[1:], 16)
    else:
        assert client.result.unwrap() == bytes.fromhex(end)


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
