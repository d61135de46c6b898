"""What a stop is, as the command line names it, and a value that is written to a node again and again.

::

    cia402:NODE                      quick stop of a drive: 0x6040 = 0x0002
    output:NODE:INDEX:SUB:VALUE      any object of a node; hexadecimal, the digits of VALUE say how wide it is
    command:PROGRAM ARGUMENT ...     a program, without a shell
    python:MODULE:FUNCTION           a function

NODE is a node-ID, or BUS/NODE where the arm has several buses.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame, Frames
from skinbus.errors import AddressError
from skinbus.model import Arm
from skinbus.node.sdo_client import ANSWER_DOWNLOAD, expedited_write
from skinbus.node.sdo_server import ABORT, FRAME_LENGTH
from skinbus.objects.cia import MAX_NODE_ID, SDO_CLIENT_BASE, SDO_SERVER_BASE, describe_abort
from skinbus.objects.profile import MASTER_NODE_ID

QUICK_STOP = "6040:0:0002"
"""Of a CiA 402 drive: the bit "quick stop" is 0, "enable voltage" stays 1; 0x605A chooses the ramp."""

RESEND_NS = 50_000_000
"""A write that is not answered so long is sent again: drives answer within 20 ms."""

REPEAT_NS = 1_000_000_000
"""A write that was confirmed is sent again: a node that was reset meanwhile stops again."""

WANTED = "cia402:NODE, output:NODE:INDEX:SUB:VALUE, command:PROGRAM ..., or python:MODULE:FUNCTION"

_OUTPUT = re.compile(
    r"output:(?:([^:/]+)/)?(\d+):(?:0x)?([0-9a-f]{1,4}):(?:0x)?([0-9a-f]{1,2}):(?:0x)?((?:[0-9a-f]{2}){1,4})",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class OutsideStop:
    """What the process does itself: a command or a Python function, in words."""

    kind: str
    what: str


@dataclass(slots=True)
class NodeWrite:
    """A value that is written to an object of a node, again and again, from the first ``step`` on."""

    label: str
    bus: int
    node_id: int
    request: bytes
    """An expedited SDO download."""
    is_confirmed: bool = False
    """Whether the last write was."""
    due_ns: int = 0
    n_unanswered: int = 0

    @classmethod
    def of(cls, label: str, bus: int, node_id: int, index: int, sub: int, data: bytes) -> NodeWrite:
        """Return one of up to four bytes."""
        return cls(label, bus, node_id, expedited_write(index, sub, data))

    @property
    def answer_id(self) -> int:
        """Identifier of the answers."""
        return SDO_SERVER_BASE + self.node_id

    def step(self, now_ns: int, frames: Frames) -> tuple[list[Frame], list[Event]]:
        """Take answers of the node; return what to send, and what became of it."""
        events: list[Event] = []

        def report(kind: EventKind, detail: str) -> None:
            self.is_confirmed = kind is EventKind.CONFIRMED
            events.append(Event(t_ns=now_ns, kind=kind, node_id=self.node_id, detail=detail, bus=self.bus))

        for can_id, data, _, flags, bus in frames:
            is_answer = (bus, can_id, flags, len(data)) == (self.bus, self.answer_id, 0, FRAME_LENGTH)
            # before it has asked, somebody else has: the same node answers the same to all
            if is_answer and self.n_unanswered and data[1:4] == self.request[1:4]:
                self.n_unanswered = 0
                if data[0] == ABORT:
                    why = describe_abort(int.from_bytes(data[4:], "little"))
                    report(EventKind.NOT_CONFIRMED, f"{self.label}: {why}")
                elif data[0] >> 5 == ANSWER_DOWNLOAD:
                    self.due_ns = now_ns + REPEAT_NS
                    if not self.is_confirmed:
                        report(EventKind.CONFIRMED, self.label)
        if now_ns < self.due_ns:
            return [], events
        if self.n_unanswered:
            report(EventKind.NOT_CONFIRMED, f"{self.label}: no answer")
        self.n_unanswered += 1
        self.due_ns = now_ns + RESEND_NS
        return [Frame(SDO_CLIENT_BASE + self.node_id, self.request, now_ns, bus=self.bus)], events


def parse_stop(text: str, arm: Arm) -> NodeWrite | OutsideStop:
    """Return a stop that the command line names.

    Raises:
        AddressError: it is none, or its node cannot be; the message says what was wanted.
    """
    kind, _, what = text.partition(":")
    if kind in ("command", "python") and what.strip():
        return OutsideStop(kind, what)
    found = _OUTPUT.fullmatch(f"output:{what}:{QUICK_STOP}" if kind == "cia402" else text)
    if not found:
        raise AddressError(f"--stop {text}: wanted {WANTED}")
    names = [settings.name for settings in arm.buses]
    name = names[0] if found[1] is None and len(names) == 1 else found[1]
    if name not in names:
        wanted = (
            f"BUS/NODE; the buses are {', '.join(names)}" if names[0] else "NODE alone: the bus has no name"
        )
        raise AddressError(f"--stop {text}: wanted {wanted}")
    bus, node_id = names.index(name), int(found[2])
    if not 1 <= node_id <= MAX_NODE_ID or node_id in (MASTER_NODE_ID, *arm.node_id[arm.patches_on(bus)]):
        raise AddressError(f"--stop {text}: wanted a node-ID, 1 to {MAX_NODE_ID}, of no patch or master")
    data = bytes.fromhex(found[5])[::-1]
    return NodeWrite.of(text, bus, node_id, int(found[3], 16), int(found[4], 16), data)
