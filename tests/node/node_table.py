"""How the conformance table is written and run: rows of frames in and frames out, from bytes to bytes.

A row is a list of steps in order. Text steps, with a note after ``;``::

    -> 600+n 40 00 10 00 00 00 00 00   frame to the device
    => 700+n                            remote frame to the device
    <- 580+n 43 00 10 00 91 01 04 00   the next frame of the device, exactly; all it sends must be listed
    -- 700+n                            the device does not listen to this identifier in its state
    ++ 500                              milliseconds pass on the virtual clock
    power                               off and on again, with the same storage

A function as a step is the device's own program acting: it is called with the device; one that is marked
``on_bench`` with the bench.
Identifiers and bytes are hexadecimal; ``n`` is the node-ID, also as a byte ``nn``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from skinbus.can.core import NEVER, receives
from skinbus.can.frame import RTR, Frame
from skinbus.node.device import Device
from skinbus.node.storage import MemoryStorage, Storage
from skinbus.objects.cia import (
    HEARTBEAT_PRODUCER,
    IDENTITY,
    IDENTITY_SERIAL,
    SYNC_PERIOD,
    NmtCommand,
    NmtState,
)
from skinbus.objects.eds import load_eds

NS_PER_MS = 1_000_000
SERIAL = 0x00C0FFEE
DEVICES = {"patch": ("skin-patch", 5), "master": ("skin-master", 127)}
BOTH = ("patch", "master")
PATCH = ("patch",)
MASTER = ("master",)

Action = Callable[[Device], object]
To = {"pre": NmtCommand.PRE_OPERATIONAL, "op": NmtCommand.START, "stopped": NmtCommand.STOP}


@dataclass(frozen=True)
class Row:
    """One rule: its name, the section of the CiA document, the state it starts in, and what happens."""

    name: str
    section: str
    steps: Sequence[str | Action]
    state: str = "pre"
    on: Sequence[str] = BOTH
    node_id: int | None = None
    storage: Callable[[], Storage | None] = MemoryStorage

    def __str__(self) -> str:
        return self.name


class Bench:
    """A device on a virtual clock, without heartbeat, and what it has sent."""

    def __init__(
        self,
        which: str,
        *,
        state: str = "pre",
        node_id: int | None = None,
        storage: Storage | None = None,
    ) -> None:
        self.which = which
        self.storage = storage
        self.node_id = node_id or DEVICES[which][1]
        self.device = self.make()
        self.now_ns = 0
        self.sent: list[Frame] = []
        self.events: list[object] = []
        if state != "off":
            self.boot()
            if state != "pre":
                self.device.command(To[state])
            self.step()
            self.sent.clear()
            self.events.clear()

    def make(self) -> Device:
        eds, node_id = DEVICES[self.which]
        device = Device(load_eds(eds, node_id), self.node_id, storage=self.storage)
        device.set(IDENTITY, IDENTITY_SERIAL, SERIAL)
        return device

    def power(self) -> None:
        self.device = self.make()
        self.boot()

    def boot(self) -> None:
        self.step()
        if self.device.nmt_state is not NmtState.INITIALISING:
            self.device.set(HEARTBEAT_PRODUCER, 0, 0)
            if SYNC_PERIOD in self.device.layout.indices:
                self.device.set(SYNC_PERIOD, 0, 0)

    def step(self, frames: Sequence[Frame] = ()) -> int:
        out, events, wake_ns = self.device.step(self.now_ns, frames)
        assert all(len(frame.data) <= 8 and frame.can_id < 0x800 for frame in out)
        self.sent += out
        self.events += events
        return wake_ns

    def pass_time(self, ns: int) -> None:
        """Let time pass, calling the device when it asked to be called."""
        end_ns = self.now_ns + ns
        wake_ns = self.step()
        while wake_ns <= end_ns:
            assert wake_ns >= self.now_ns
            self.now_ns = wake_ns
            wake_ns = self.step()
            assert wake_ns > self.now_ns or wake_ns == NEVER, "the device asks to be called for ever"
        self.now_ns = end_ns
        self.step()

    def frame(self, text: str) -> Frame:
        can_id, *data = text.split()
        base, _, plus = can_id.partition("+")
        number = int(base, 16) + (self.node_id if plus == "n" else int(plus or "0", 16))
        return Frame(number, bytes(self.node_id if b == "nn" else int(b, 16) for b in data))


def show(frame: Frame) -> str:
    return f"{frame.can_id:03X} {frame.data.hex(' ').upper()}".strip()


def run(row: Row, which: str, bench: Bench | None = None) -> Bench:
    """Run a row and compare every frame; returns the bench for what a row cannot say."""
    bench = bench or Bench(which, state=row.state, node_id=row.node_id, storage=row.storage())
    for i, step in enumerate(row.steps):
        where = f"{row.name} on {which}, step {i + 1}"
        if callable(step):
            assert not bench.sent, f"{where}: unexpected {show(bench.sent[0])}"
            if getattr(step, "on_bench", False):
                step(bench)
            else:
                step(bench.device)
                bench.step()
            continue
        text = step.partition(";")[0].strip()
        kind, _, rest = text.partition(" ")
        if kind == "<-":
            assert bench.sent, f"{where}: nothing sent, wanted {rest}"
            got, wanted = show(bench.sent.pop(0)), show(bench.frame(rest))
            assert got == wanted, f"{where}: {step}"
            continue
        assert not bench.sent, f"{where}: unexpected {show(bench.sent[0])} before {step}"
        if kind in ("->", "=>"):
            frame = bench.frame(rest)
            if kind == "=>":
                frame = frame._replace(flags=RTR)
            # what the device does not listen to never reaches it on the wire; it must not matter if it does
            bench.step([frame])
            if not receives(bench.device.cob_ids, frame):
                assert not bench.sent, f"{where}: answered a frame it does not listen to"
        elif kind == "--":
            assert bench.frame(rest).can_id not in bench.device.cob_ids, where
        elif kind == "power":
            bench.power()
        elif kind == "++":
            bench.pass_time(int(float(rest) * NS_PER_MS))
        else:
            raise ValueError(step)
    assert not bench.sent, f"{row.name} on {which}: unexpected {show(bench.sent[0])} at the end"
    assert bench.device.nmt_state in NmtState
    return bench


# --- SDO steps in short: what is written here is one frame each ------------------------------------


def _place(place: str) -> str:
    index, _, sub = place.partition(":")
    return f"{index[2:]} {index[:2]} {sub}"


def _pad(data: str) -> str:
    return " ".join([*data.split(), *["00"] * (4 - len(data.split()))])


def up(place: str) -> str:
    """A client asks to read, as in ``up("1018:04")``."""
    return f"-> 600+n 40 {_place(place)} 00 00 00 00 ; read {place}"


def got(place: str, data: str) -> str:
    """The expedited answer to it."""
    return f"<- 580+n {0x43 | (4 - len(data.split())) << 2:02X} {_place(place)} {_pad(data)}"


def down(place: str, data: str) -> str:
    """A client writes up to four bytes, expedited."""
    return f"-> 600+n {0x23 | (4 - len(data.split())) << 2:02X} {_place(place)} {_pad(data)} ; write {place}"


def done(place: str) -> str:
    """The answer to it."""
    return f"<- 580+n 60 {_place(place)} 00 00 00 00"


def no(place: str, code: int) -> str:
    """An abort."""
    return f"<- 580+n 80 {_place(place)} {code.to_bytes(4, 'little').hex(' ')} ; 0x{code:08X}"


def reads(place: str, data: str) -> list[str]:
    return [up(place), got(place, data)]


def writes(place: str, data: str) -> list[str]:
    return [down(place, data), done(place)]


def refuses(place: str, data: str, code: int) -> list[str]:
    return [down(place, data), no(place, code)]
