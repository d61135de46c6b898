"""What a stop is, as the command line names it, and a value that is written to a node until it is confirmed.

::

    cia402:NODE                      quick stop of a drive: 0x6040 = 0x0002
    output:NODE:INDEX:SUB:VALUE      any object of a node; hexadecimal, the digits of VALUE say how wide it is
    command:PROGRAM ARGUMENT ...     a program, without a shell
    python:MODULE:FUNCTION           a function

NODE is a node-ID, or BUS/NODE where the arm has several buses.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass

from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame, Frames
from skinbus.errors import AddressError
from skinbus.model import Arm
from skinbus.node.sdo_client import SdoClient
from skinbus.objects.cia import MAX_NODE_ID, describe_abort

CONTROLWORD = 0x6040
QUICK_STOP = struct.pack("<H", 0x0002)
"""Of a CiA 402 drive: the bit "quick stop" is 0, "enable voltage" stays 1; 0x605A chooses the ramp."""

RESEND_NS = 50_000_000
"""A write that is not answered so long is sent again: drives answer within 20 ms."""

REPEAT_NS = 1_000_000_000
"""A write that was confirmed is sent again: a node that was reset meanwhile stops again."""

USAGE = "cia402:NODE, output:NODE:INDEX:SUB:VALUE, command:PROGRAM ..., or python:MODULE:FUNCTION"

_NODE = r"(?:(?P<bus>[^:/]+)/)?(?P<node>\d+)"
_CIA402 = re.compile(rf"cia402:{_NODE}")
_OUTPUT = re.compile(
    rf"output:{_NODE}:(?:0x)?(?P<index>[0-9a-f]{{1,4}}):(?:0x)?(?P<sub>[0-9a-f]{{1,2}}):(?:0x)?(?P<value>(?:[0-9a-f]{{2}}){{1,4}})",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class NodeStop:
    """An object of a node and the value that stops."""

    bus: int
    node_id: int
    index: int
    sub: int
    data: bytes
    label: str


@dataclass(frozen=True, slots=True)
class OutsideStop:
    """What the process does itself: a command or a Python function, in words."""

    kind: str
    what: str


def parse_stop(text: str, arm: Arm) -> NodeStop | OutsideStop:
    """Return a stop that the command line names.

    Raises:
        AddressError: it is none, or its node cannot be; the message says what was wanted.
    """
    kind, _, what = text.partition(":")
    if kind in ("command", "python") and what.strip():
        return OutsideStop(kind, what)
    if found := _CIA402.fullmatch(text):
        index, sub, data = CONTROLWORD, 0, QUICK_STOP
    elif found := _OUTPUT.fullmatch(text):
        index, sub = int(found["index"], 16), int(found["sub"], 16)
        data = bytes.fromhex(found["value"])[::-1]
    else:
        raise AddressError(f"--stop {text}: wanted {USAGE}")
    names = [bus.name for bus in arm.buses]
    if (len(names) > 1 or found["bus"] is not None) and found["bus"] not in names:
        raise AddressError(f"--stop {text}: wanted BUS/NODE; the buses are {', '.join(names)}")
    bus, node_id = names.index(found["bus"]) if found["bus"] else 0, int(found["node"])
    if not 1 <= node_id <= MAX_NODE_ID or node_id in arm.node_id[arm.patches_on(bus)]:
        raise AddressError(f"--stop {text}: wanted a node-ID, 1 to {MAX_NODE_ID}, that no patch has")
    return NodeStop(bus, node_id, index, sub, data, text)


class Writer:
    """Writes the value of a stop again and again, from the first ``step`` on."""

    def __init__(self, stop: NodeStop) -> None:
        self.stop = stop
        self.is_confirmed = False
        """Whether the last write was."""
        self.wake_ns = 0
        self.client = SdoClient(stop.node_id, timeout_ns=RESEND_NS)
        self._due_ns = self._complain_ns = 0

    def step(self, now_ns: int, frames: Frames) -> tuple[list[Frame], list[Event]]:
        """Take answers of the node; return what to send, and what became of it."""
        stop, client, events = self.stop, self.client, []
        out = client.step(now_ns, [frame for frame in frames if frame.bus == stop.bus])
        if (result := client.result) is not None and not client.busy:
            client.result = None
            if result.abort is None:
                self._due_ns = now_ns + REPEAT_NS
                if not self.is_confirmed:
                    events.append(self._event(now_ns, EventKind.STOP_CONFIRMED, stop.label))
            else:
                # a node that refuses is asked again as late as one that is silent
                self._due_ns = now_ns + RESEND_NS if result.remote else now_ns
                if now_ns >= self._complain_ns:
                    self._complain_ns = now_ns + REPEAT_NS
                    why = f"{stop.label}: {describe_abort(result.abort)}"
                    events.append(self._event(now_ns, EventKind.STOP_FAILED, why))
            self.is_confirmed = result.abort is None
        if not client.busy and now_ns >= self._due_ns:
            client.start_write(stop.index, stop.sub, stop.data)
            out += client.step(now_ns)
        self.wake_ns = client.wake_ns if client.busy else self._due_ns
        return [frame._replace(bus=stop.bus) for frame in out], events

    def _event(self, now_ns: int, kind: EventKind, detail: str) -> Event:
        return Event(t_ns=now_ns, kind=kind, node_id=self.stop.node_id, detail=detail, bus=self.stop.bus)
