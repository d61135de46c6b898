"""Node-IDs for the nodes of a bus: by serial number where it is known, in order of identity for all others.

First the bus is scanned, so that no node-ID is given twice. Nodes known by serial number may have another
node-ID already; they all take their new ones together, so that two may swap. One that does not take its new
one keeps the old one, and nobody else gets that.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.master.commissioning.scan import Scanner
from skinbus.master.commissioning.sessions import LSS_TIMEOUT_NS, Exchange, Script, Sessions, Timeouts
from skinbus.node.lss import FASTSCAN_ALL, UNCONFIGURED, Lss, Mode, lss_request
from skinbus.node.nmt import nmt_frame
from skinbus.objects import cia

STORE_FACTOR = 50
"""A slave that writes to flash takes longer to answer, times the time-out: 1 s."""

BOOT_FACTOR = 50
"""A slave that takes a node-ID boots with it in so many time-outs: 1 s."""

BITS = 32
_FASTSCAN = struct.Struct("<BIBBB")

SWITCH_SELECTIVE = (Lss.SWITCH_VENDOR, Lss.SWITCH_PRODUCT, Lss.SWITCH_REVISION, Lss.SWITCH_SERIAL)


class Address(NamedTuple):
    """The LSS address of a node, which no other node has: its identity, 0x1018."""

    vendor: int
    product: int
    revision: int
    serial: int

    def __str__(self) -> str:
        return f"{self.vendor:X}:{self.product:X}:{self.revision:X}:{self.serial}"


def switch_all(mode: Mode) -> Script[None]:
    """Put all nodes into a mode; nobody answers, but all are given time."""
    yield Exchange((switch_all_frame(mode),), None)


def switch_all_frame(mode: Mode) -> Frame:
    """Return the frame that puts all nodes into a mode."""
    return lss_request(Lss.SWITCH_GLOBAL, bytes([mode.value]))


def select(address: Address) -> Script[bool]:
    """Put the node with this identity into configuration, if it is there."""
    frames = tuple(
        lss_request(command, number.to_bytes(4, "little"))
        for command, number in zip(SWITCH_SELECTIVE, address, strict=True)
    )
    answers = yield Exchange(frames, first=Lss.SWITCHED)
    return bool(answers)


def inquire_node_ids() -> Script[list[int]]:
    """Return the node-IDs of the nodes in configuration, 255 for none yet; there should be one."""
    answers = yield _ask(Lss.INQUIRE_NODE_ID, awaits_all=True)
    return [answer[1] for answer in answers if len(answer) > 1]


def configure_node_id(node_id: int) -> Script[str]:
    """Give the node in configuration a node-ID; return what is wrong, or nothing."""
    answers = yield _ask(Lss.CONFIGURE_NODE_ID, bytes([node_id]), awaits_all=True)
    if len(answers) == 1:
        return "" if _is_good(answers[0]) else f"refused node-ID {node_id}"
    fault = same_identity(len(answers)) if answers else "did not answer when it was given a node-ID"
    return f"{fault}; it may have taken node-ID {node_id}, which it has not stored: switch it off and on"


def same_identity(n: int) -> str:
    """Return what is wrong with n nodes that LSS cannot distinguish."""
    return f"{n} nodes have this identity, serial number and all; connect one at a time"


def store() -> Script[str]:
    """Make the node in configuration store its node-ID; return what is wrong, or nothing."""
    answers = yield _ask(Lss.STORE, timeout_factor=STORE_FACTOR)
    if not answers:
        return "did not answer the store command"
    if not _is_good(answers[0]):
        return "cannot store its node-ID: it is lost when the node is switched off"
    return ""


def wait_for_boot_up(node_id: int, *commands: Frame) -> Script[bool]:
    """Return whether a node sends a boot-up message after commands that make it boot."""
    answers = yield Exchange(commands, cia.HEARTBEAT_BASE + node_id, 0, BOOT_FACTOR)
    return bool(answers)


def fastscan(hints: Sequence[Sequence[int]] = ()) -> Script[Address | None]:
    """Find one node without node-ID and put it into configuration; None when there is none.

    ``hints`` are identities, or their first numbers, that are likely: each is tried whole.
    """
    if not (yield from _scan(0, FASTSCAN_ALL, 0, 0)):
        return None
    found: list[int] = []
    for part in range(len(Address._fields)):
        following = (part + 1) % len(Address._fields)
        likely = {h[part] for h in hints if len(h) > part and list(h[:part]) == found}
        number = yield from _scan_number(sorted(likely), part, following)
        if number is None:
            return None
        found.append(number)
    return Address(*found)


def _scan_number(likely: Sequence[int], part: int, following: int) -> Script[int | None]:
    """Find one number of an identity; None when whoever answered has fallen silent."""
    for number in likely:
        if (yield from _scan(number, 0, part, following)):
            return number
    number = 0
    for bit in reversed(range(BITS)):
        if not (yield from _scan(number, bit, part, part)):
            number |= 1 << bit
    return number if (yield from _scan(number, 0, part, following)) else None


def _scan(number: int, bit: int, part: int, following: int) -> Script[bool]:
    request = Frame(cia.LSS_MASTER_ID, _FASTSCAN.pack(Lss.FASTSCAN, number, bit, part, following))
    answers = yield Exchange((request,), first=Lss.IDENTIFIED, awaits_all=True)
    return bool(answers)


def _is_good(answer: bytes) -> bool:
    """Whether an answer reports success."""
    return answer[1:2] == b"\0"


def _ask(
    command: Lss, data: bytes = b"", *, timeout_factor: float = 1.0, awaits_all: bool = False
) -> Exchange:
    return Exchange(
        (lss_request(command, data),), first=command, timeout_factor=timeout_factor, awaits_all=awaits_all
    )


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


@dataclass(frozen=True, slots=True)
class Assignment:
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


class Assigner(Core):
    """A core that gives node-IDs and then asks its host to stop; beside another master it sends nothing.

    Args:
        known: nodes to be found by their identity.
        free: node-IDs for the nodes that fastscan finds, in this order; those in use are left out.
        hints: identities, or their first numbers, that fastscan tries whole.
    """

    cob_ids: frozenset[int] | None = frozenset()

    def __init__(
        self,
        *,
        known: Sequence[Known] = (),
        free: Sequence[int] = (),
        hints: Sequence[Sequence[int]] = (),
        timeout_ns: int = LSS_TIMEOUT_NS,
        on_result: Callable[[Assignment], object] | None = None,
    ) -> None:
        self.results: list[Assignment] = []
        self.is_over_full = False
        """Whether nodes without node-ID are left, and no node-ID for them."""
        self.scanner = Scanner()
        self._known = tuple(known)
        self._free = tuple(free)
        self._hints = tuple(hints)
        self._on_result = on_result
        self._session: Sessions[None] = Sessions(Timeouts(lss_ns=timeout_ns))
        self._scanned = False
        self.cob_ids = self.scanner.cob_ids

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Take frames up to now; return frames to send, events, and the time of the next wake-up."""
        if not self._scanned:
            step = self.scanner.step(now_ns, frames)
            self._scanned = any(event.kind == EventKind.STOP for event in step.events)
            if not self._scanned:
                return step
            if self.scanner.other_master.is_present:
                return Step((), [Event(t_ns=now_ns, kind=EventKind.STOP)], NEVER)
            out = self._session.begin(now_ns, 0, 0, self._run())
        else:
            out, _ = self._session.step(now_ns, {0: frames})
        if not self._session:
            return Step(out, [Event(t_ns=now_ns, kind=EventKind.STOP)], NEVER)
        return Step(out, (), self._session.wake_ns)

    def _run(self) -> Script[None]:
        """Give all nodes their node-IDs."""
        yield from switch_all(Mode.WAITING)
        taken = set(self.scanner.nodes)
        if self._known:
            yield from self._assign_known(taken)
        given = {known.node_id for known in self._known}
        free = [node_id for node_id in self._free if node_id not in taken | given]
        seen: set[Address] = set()
        while (address := (yield from fastscan(self._hints))) is not None:
            if address in seen:
                fault = "answers fastscan though it has a node-ID"
                self._report(Assignment(0, address, Assigned.REFUSED, fault))
                break
            seen.add(address)
            if not free:
                self.is_over_full = True
                break
            result = yield from self._give(Known(address, free.pop(0)), UNCONFIGURED, is_selected=True)
            result = yield from self._let_take(result)
            self._report(result)
            if result.outcome is Assigned.REFUSED:
                break  # it would be found again, and again
        yield from switch_all(Mode.WAITING)

    def _assign_known(self, taken: set[int]) -> Script[None]:
        """Give the nodes with known identity their node-IDs: those that have one first, together."""
        for node_id, node in self.scanner.nodes.items():  # LSS is not for operational nodes (CiA 305, 3.4)
            if node.state in (None, cia.NmtState.OPERATIONAL):
                command = nmt_frame(cia.NmtCommand.PRE_OPERATIONAL, node_id)
                yield Exchange((command,), None, timeout_factor=0.1)
        old = yield from self._find_known()
        taken.difference_update(old.values())
        moved: list[Known] = []
        new: list[Known] = []
        for known, had in old.items():
            if had == known.node_id:
                taken.add(had)
                self._report(Assignment(had, known.address, Assigned.SAME, "", had))
            else:
                (new if had == UNCONFIGURED else moved).append(known)
        yield from self._move(moved, old, taken)
        for known in self._blocked(new, taken, old):
            self._refuse_taken(known, old[known])
        for known in new:
            result = yield from self._give(known, UNCONFIGURED)
            result = yield from self._let_take(result)
            self._report(result)
        taken |= {result.node_id for result in self.results}

    def _move(self, moved: list[Known], old: dict[Known, int], taken: set[int]) -> Script[None]:
        """Let nodes exchange their node-IDs; what one that does not move keeps is given to no other."""
        for known in self._blocked(moved, taken, old):
            self._refuse_taken(known, old[known])
        given: dict[Known, Assignment] = {}
        for known in moved:
            given[known] = yield from self._give(known, old[known])
            yield from switch_all(Mode.WAITING)
        refused = [known for known in moved if given[known].outcome is Assigned.REFUSED]
        for known in refused:
            moved.remove(known)
            taken.add(old[known])
            self._report(given[known])
        for known in self._blocked(moved, taken, old):  # it has not used what it was given yet
            back = yield from self._give(known._replace(node_id=old[known]), old[known])
            yield from switch_all(Mode.WAITING)
            is_back = back.outcome is not Assigned.REFUSED
            more = "" if is_back else "; it has that when it is reset: assign again"
            self._refuse_taken(known, old[known], more)
        for known in moved:
            # All at once is not needed for a swap: two nodes share a node-ID until the second is reset too.
            reset = nmt_frame(cia.NmtCommand.RESET_COMMUNICATION, old[known])
            result = given[known]
            if not (yield from wait_for_boot_up(known.node_id, reset)):
                taken.add(old[known])
                result = _not_seen(result)
            taken.add(known.node_id)
            self._report(result)

    def _blocked(self, nodes: list[Known], taken: set[int], old: dict[Known, int]) -> list[Known]:
        """Take out of ``nodes``, and return, those whose node-ID is taken and those that would get theirs."""
        blocked: list[Known] = []
        while found := [known for known in nodes if known.node_id in taken]:
            for known in found:
                nodes.remove(known)
                taken.add(old[known])
            blocked += found
        return blocked

    def _refuse_taken(self, known: Known, old: int, more: str = "") -> None:
        """Report a node that keeps the node-ID it has."""
        reason = f"node-ID {known.node_id} is taken by another node{more}"
        self._report(Assignment(known.node_id, known.address, Assigned.REFUSED, reason, old))

    def _find_known(self) -> Script[dict[Known, int]]:
        """Return the present node-IDs of the known nodes that are there."""
        old: dict[Known, int] = {}
        for known in self._known:
            node_ids: list[int] | None = None
            for _ in range(SELECT_TRIES):
                if (yield from select(known.address)):
                    node_ids = yield from inquire_node_ids()
                    yield from switch_all(Mode.WAITING)
                    break
            if node_ids is None:
                self._report(Assignment(known.node_id, known.address, Assigned.ABSENT, "does not answer"))
            elif len(node_ids) > 1:
                reason = f"{same_identity(len(node_ids))} (node-IDs {sorted(node_ids)}, as before)"
                self._report(Assignment(known.node_id, known.address, Assigned.REFUSED, reason))
            else:
                old[known] = node_ids[0] if node_ids else UNCONFIGURED
        return old

    def _give(self, known: Known, old: int, *, is_selected: bool = False) -> Script[Assignment]:
        """Give a node its node-ID in place of ``old`` and let it store it."""
        result = Assignment(known.node_id, known.address, Assigned.ASSIGNED, old=old)
        if not is_selected and not (yield from select(known.address)):
            return replace(result, outcome=Assigned.REFUSED, reason="stopped answering")
        if fault := (yield from configure_node_id(known.node_id)):
            return replace(result, outcome=Assigned.REFUSED, reason=fault)
        fault = yield from store()
        return replace(result, outcome=Assigned.NOT_STORED, reason=fault) if fault else result

    def _let_take(self, result: Assignment) -> Script[Assignment]:
        """Let a node that had no node-ID take it, and look whether it does."""
        if result.outcome is Assigned.REFUSED:
            return result
        seen = yield from wait_for_boot_up(result.node_id, switch_all_frame(Mode.WAITING))
        return result if seen else _not_seen(result)

    def _report(self, result: Assignment) -> None:
        self.results.append(result)
        if self._on_result:
            self._on_result(result)


def _not_seen(result: Assignment) -> Assignment:
    """Return what came of a node that sent no boot-up message."""
    if result.outcome is not Assigned.ASSIGNED:
        return result
    return replace(result, outcome=Assigned.NOT_SEEN, reason="no boot-up message")
