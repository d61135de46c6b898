"""Node-IDs for the nodes of a bus: by serial number where it is known, in order of identity for all others.

First the bus is scanned, so that no node-ID is given twice. Nodes known by serial number may have another
node-ID already. They take their new ones one after the other, those first whose new one is free; where nodes
exchange theirs, two have the same for a moment. What came of each is reported; nothing is taken back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Any, NamedTuple

from skinbus.can.core import Step
from skinbus.can.event import EventKind
from skinbus.can.frame import Frame, Frames
from skinbus.master.commissioning.scan import Scanner
from skinbus.master.commissioning.sessions import Listen, Script, ScriptCore
from skinbus.node.lss import FASTSCAN, FASTSCAN_ALL, UNCONFIGURED, Lss, Mode, lss_request
from skinbus.node.nmt import nmt_frame
from skinbus.objects import cia

LSS_TIMEOUT_NS = 20_000_000
"""What most LSS masters give a slave to answer; fastscan waits so long for every one bit."""

SLOW = 50
"""Times as long a slave may take that writes to flash, or boots: 1 s."""

SETTLE_SHARE = 4
"""After a first answer others are awaited for this fraction of the time-out."""

BITS = 32

SWITCH_SELECTIVE = range(Lss.SWITCH_VENDOR, Lss.SWITCH_SERIAL + 1)


class Address(NamedTuple):
    """The LSS address of a node, which no other node has: its identity, 0x1018."""

    vendor: int
    product: int
    revision: int
    serial: int

    def __str__(self) -> str:
        return f"{self.vendor:X}:{self.product:X}:{self.revision:X}:{self.serial}"


RELEASE = lss_request(Lss.SWITCH_GLOBAL, bytes([Mode.WAITING]))
"""The frame that lets all nodes wait."""


def same_identity(n: int) -> str:
    """Return what is wrong with n nodes that LSS cannot distinguish."""
    return f"{n} nodes have this identity, serial number and all; connect one at a time"


SELECT_TRIES = 2


class Assigned(StrEnum):
    """What came of one node."""

    ASSIGNED = "assigned"
    SAME = "had it already"
    NOT_STORED = "not stored"
    """It has its node-ID until it is switched off."""
    NOT_SEEN = "not seen"
    """It took its node-ID and stored it, but sent no boot-up message with it."""
    REFUSED = "refused"
    ABSENT = "absent"

    @property
    def is_good(self) -> bool:
        """Whether the node has its node-ID for good."""
        return self in (Assigned.ASSIGNED, Assigned.SAME)


class Assignment(NamedTuple):
    """What came of one node."""

    node_id: int
    """The one it was to get."""
    address: Address
    outcome: Assigned
    reason: str = ""
    old: int = UNCONFIGURED


class Known(NamedTuple):
    """A node that is known by its whole identity, and the node-ID it is to have."""

    address: Address
    node_id: int


class Assigner(ScriptCore):
    """A core that gives node-IDs and then asks its host to stop; beside another master it sends nothing.

    Args:
        known: nodes to be found by their identity.
        free: node-IDs for the nodes that fastscan finds, in this order; those in use are left out.
    """

    def __init__(
        self,
        *,
        known: Sequence[Known] = (),
        free: Sequence[int] = (),
        timeout_ns: int = LSS_TIMEOUT_NS,
        on_result: Callable[[Assignment], object] | None = None,
    ) -> None:
        super().__init__(self._run())
        self.results: list[Assignment] = []
        self.is_over_full = False
        """Whether nodes without node-ID are left, and no node-ID for them."""
        self.scanner = Scanner()
        self._known = known
        self._free = free
        self._on_result = on_result
        self._timeout_ns = timeout_ns
        self._scanned = False
        self.cob_ids = self.scanner.cob_ids

    def step(self, now_ns: int, frames: Frames) -> Step:
        """Take frames up to now; return frames to send, events, and the time of the next wake-up."""
        if not self._scanned:
            step = self.scanner.step(now_ns, frames)
            self._scanned = any(event.kind == EventKind.STOP for event in step.events)
            if not self._scanned or self.scanner.other_master.is_present:
                return step
        return super().step(now_ns, frames)

    def _run(self) -> Script[None]:
        """Give all nodes their node-IDs."""
        yield from self._release()
        taken = set(self.scanner.nodes)
        if self._known:
            yield from self._assign_known(taken)
        taken.update(known.node_id for known in self._known)
        free = [node_id for node_id in self._free if node_id not in taken]
        seen: set[Address] = set()
        while (address := (yield from self._fastscan())) is not None:
            if address in seen:
                self._report(0, address, Assigned.REFUSED, "answers fastscan though it has a node-ID")
                break
            seen.add(address)
            if not free:
                self.is_over_full = True
                break
            node_id = free.pop(0)
            outcome, fault = yield from self._give(node_id)
            self._report(node_id, address, outcome, fault)
            if outcome is Assigned.REFUSED:
                break  # it would be found again, and again
        yield from self._release()

    def _assign_known(self, taken: set[int]) -> Script[None]:
        """Give the nodes with known identity their node-IDs."""
        # LSS is not for operational nodes (CiA 305, 3.4)
        yield Listen(LSS_TIMEOUT_NS, send=(nmt_frame(cia.NmtCommand.PRE_OPERATIONAL, 0),))
        old = yield from self._find_known()
        taken.difference_update(old.values())
        for (address, node_id), had in old.items():
            if had == node_id:
                taken.add(had)
                self._report(node_id, address, Assigned.SAME, "", had)
        pending = [known for known in old if old[known] != known.node_id]
        while pending:
            held = {old[known] for known in pending}
            known = next((known for known in pending if known.node_id not in held), pending[0])
            pending.remove(known)
            (address, node_id), had = known, old[known]
            outcome, fault = Assigned.REFUSED, f"node-ID {node_id} is taken by another node"
            if node_id not in taken:
                fault = "stopped answering"
                if (yield from self._select(address)):
                    outcome, fault = yield from self._give(node_id, had)
            if outcome is Assigned.REFUSED and had in taken:
                fault += f"; two nodes have node-ID {had} now"
            taken.add(had if outcome is Assigned.REFUSED else node_id)
            if outcome is Assigned.NOT_SEEN:
                taken.add(had)
            self._report(node_id, address, outcome, fault, had)

    def _find_known(self) -> Script[dict[Known, int]]:
        """Return the present node-IDs of the known nodes that are there."""
        old: dict[Known, int] = {}
        for known in self._known:
            for _ in range(SELECT_TRIES):
                if (yield from self._select(known.address)):
                    break
            else:
                self._report(known.node_id, known.address, Assigned.ABSENT, "does not answer")
                continue
            node_ids = yield from self._inquire_node_ids()
            yield from self._release()
            if len(node_ids) > 1:
                fault = f"{same_identity(len(node_ids))} (node-IDs {sorted(node_ids)}, as before)"
                self._report(known.node_id, known.address, Assigned.REFUSED, fault)
            else:
                old[known] = node_ids[0] if node_ids else UNCONFIGURED
        return old

    def _give(self, node_id: int, old: int = UNCONFIGURED) -> Script[tuple[Assigned, str]]:
        """Let the node in configuration store a node-ID and boot with it; return what came of it, and why."""
        fault = yield from self._configure_node_id(node_id)
        if fault:
            yield from self._release()
            return Assigned.REFUSED, fault
        fault = yield from self._store()
        command = RELEASE
        if old != UNCONFIGURED:  # one that has no node-ID yet boots when it is let go
            yield from self._release()
            command = nmt_frame(cia.NmtCommand.RESET_COMMUNICATION, old)
        boot_ups = yield from self._ask(0, command, slower=SLOW, can_id=cia.HEARTBEAT_BASE + node_id)
        if fault:
            return Assigned.NOT_STORED, fault
        return (Assigned.ASSIGNED, "") if boot_ups else (Assigned.NOT_SEEN, "no boot-up message")

    def _report(self, *result: Any) -> None:
        self.results.append(Assignment(*result))
        if self._on_result:
            self._on_result(self.results[-1])

    def _ask(
        self,
        first: int,
        *frames: Frame,
        slower: int = 1,
        awaits_all: bool = False,
        can_id: int = cia.LSS_SLAVE_ID,
    ) -> Script[list[bytes]]:
        """Send frames; return the answers that begin with a byte: one, or all that come."""
        ns = slower * self._timeout_ns

        def is_answer(frame: Frame) -> bool:
            return frame.can_id == can_id and frame.data[:1] == bytes([first])

        received = yield Listen(ns, is_answer, frames, ns // SETTLE_SHARE if awaits_all else 0)
        return [frame.data for frame in received if is_answer(frame)]

    def _release(self) -> Script[None]:
        """Let all nodes wait; nobody answers, but all are given time."""
        yield Listen(self._timeout_ns, send=(RELEASE,))

    def _select(self, address: Sequence[int]) -> Script[bool]:
        """Put the node with this identity into configuration, if it is there."""
        numbers = [number.to_bytes(4, "little") for number in address]
        return bool((yield from self._ask(Lss.SWITCHED, *map(lss_request, SWITCH_SELECTIVE, numbers))))

    def _inquire_node_ids(self) -> Script[list[int]]:
        """Return the node-IDs of the nodes in configuration, 255 for none yet; there should be one."""
        command = Lss.INQUIRE_NODE_ID
        answers = yield from self._ask(command, lss_request(command), awaits_all=True)
        return [answer[1] for answer in answers if len(answer) > 1]

    def _configure_node_id(self, node_id: int) -> Script[str]:
        """Give the node in configuration a node-ID; return what is wrong, or nothing."""
        command = Lss.CONFIGURE_NODE_ID
        answers = yield from self._ask(command, lss_request(command, bytes([node_id])), awaits_all=True)
        if len(answers) == 1:
            return "" if answers[0][1:2] == b"\0" else f"refused node-ID {node_id}"
        fault = same_identity(len(answers)) if answers else "did not answer when it was given a node-ID"
        return f"{fault}; it may have taken node-ID {node_id}, which it has not stored: switch it off and on"

    def _store(self) -> Script[str]:
        """Make the node in configuration store its node-ID; return what is wrong, or nothing."""
        answers = yield from self._ask(Lss.STORE, lss_request(Lss.STORE), slower=SLOW)
        if not answers:
            return "did not answer the store command"
        is_good = answers[0][1:2] == b"\0"
        return "" if is_good else "cannot store its node-ID: it is lost when the node is switched off"

    def _fastscan(self) -> Script[Address | None]:
        """Find one node without node-ID and put it into configuration; None when there is none."""
        if not (yield from self._is_there(0, FASTSCAN_ALL, 0, 0)):
            return None
        found: list[int] = []
        for part in range(len(Address._fields)):
            following = (part + 1) % len(Address._fields)
            number = 0
            for bit in reversed(range(BITS)):
                if not (yield from self._is_there(number, bit, part, part)):
                    number |= 1 << bit
            if not (yield from self._is_there(number, 0, part, following)):
                return None  # whoever answered has fallen silent
            found.append(number)
        return Address(*found)

    def _is_there(self, number: int, bit: int, part: int, following: int) -> Script[bool]:
        request = lss_request(Lss.FASTSCAN, FASTSCAN.pack(number, bit, part, following))
        return bool((yield from self._ask(Lss.IDENTIFIED, request, awaits_all=True)))
