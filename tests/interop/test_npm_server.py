"""The JavaScript stack as a device made from our own EDS: our SDO client reads and writes it."""

import pytest

from skinbus.can.core import Core, Step
from skinbus.errors import SdoAborted
from skinbus.node.sdo_client import SdoClient
from tests.interop.peer import resolved_eds

NODE = 9


class Session(Core):
    """Our client on the wire of a device of theirs."""

    cob_ids = frozenset({0x580 + NODE})

    def __init__(self, bench):
        self.bench, self.sdo = bench, SdoClient(NODE)
        self.port = bench.attach(self)

    def step(self, now_ns, frames):
        return Step(self.sdo.step(now_ns, frames), (), self.sdo.wake_ns)

    def read(self, index, sub):
        self.sdo.start_read(index, sub)
        return self.end()

    def write(self, index, sub, data):
        self.sdo.start_write(index, sub, data)
        return self.end()

    def end(self):
        self.bench.wire.wake(self.port)
        while self.sdo.busy:
            self.bench.pass_ms(1)
        return self.sdo.result.unwrap()


@pytest.fixture
def session(bench, tmp_path):
    """Our client, and their device with our EDS, on one wire."""
    bench.ask("open", id=NODE, eds=str(resolved_eds("skin-patch", NODE, tmp_path)))
    bench.ask("start")
    return Session(bench)


@pytest.mark.parametrize(
    ("index", "sub", "data"),
    [(0x1000, 0, bytes.fromhex("91010400")), (0x1018, 2, bytes.fromhex("01500000")), (0x1001, 0, b"\0")],
)
def test_expedited_read(session, index, sub, data):
    assert session.read(index, sub) == data


def test_heartbeat_begins_when_it_is_switched_on(session):
    session.write(0x1017, 0, b"\x64\x00")
    session.bench.pass_ms(1050)
    beats = [frame for frame in session.bench.frames if frame.can_id == 0x700 + NODE]
    assert len(beats) == 10
    assert {frame.data for frame in beats} == {b"\x7f"}


@pytest.mark.parametrize(
    ("index", "sub", "data", "code"),
    [(0x5FFF, 0, None, 0x06020000), (0x1000, 0, bytes(4), 0x06010002)],
)
def test_their_refusal_is_raised_with_its_code(session, index, sub, data, code):
    with pytest.raises(SdoAborted) as caught:
        session.read(index, sub) if data is None else session.write(index, sub, data)
    assert caught.value.code == code
