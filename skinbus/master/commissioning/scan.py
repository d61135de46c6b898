"""Scan of a bus: the identity of every node-ID is read, side by side; heartbeats report the states.

A node that answers no SDO but sends heartbeats is found too: it is stopped, or not a full CANopen device.
Nodes without node-ID are detected; LSS can find them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.master.commissioning.sessions import Request, Script, Sessions
from skinbus.master.other_master import OtherMaster
from skinbus.master.patches.provisioning import NUMBERS, Identity
from skinbus.node.lss import Lss, lss_request
from skinbus.objects import cia

LISTEN_NS = 1_100_000_000
"""Heartbeats are waited for so long: their usual periods are 1 s and less."""


TEXTS = (
    ("name", cia.DEVICE_NAME),
    ("hardware", cia.HARDWARE_VERSION),
    ("software", cia.SOFTWARE_VERSION),
)


@dataclass(slots=True)
class Found:
    """One node as it describes itself; a number is None when it was not answered."""

    node_id: int
    state: cia.NmtState | None = None
    """From its heartbeat; None when it has none, or an unknown one."""
    answers: bool = False
    """Whether it answers SDO requests."""
    numbers: dict[str, int | None] = field(default_factory=dict)
    """By the names in ``NUMBERS``."""
    texts: dict[str, str] = field(default_factory=dict)
    """By the names in ``TEXTS``; those it has."""
    error_register: int | None = None


class Candidate(NamedTuple):
    """An EDS that a node may match."""

    name: str
    identity: Identity


class Match(NamedTuple):
    """The EDS files that describe a node best; ``exact`` when the revision is the same too."""

    names: tuple[str, ...]
    exact: bool


def match(node: Found, candidates: Iterable[Candidate]) -> Match:
    """Return the EDS files of a node: same device type, vendor and product; of those the best.

    Better is the same revision, and then the same serial number; an EDS that gives none of them fits any.
    """
    ranked: dict[tuple[bool, bool], list[str]] = {}
    seen = node.numbers
    for name, wanted in candidates:
        same = (wanted.vendor, wanted.product) == (seen.get("vendor"), seen.get("product"))
        if not same or wanted.device_type not in (0, seen.get("device_type")):
            continue
        if wanted.serial not in (0, seen.get("serial")):
            continue
        exact = wanted.revision in (0, seen.get("revision"))
        ranked.setdefault((exact, wanted.serial != 0), []).append(name)
    if not ranked:
        return Match((), False)
    best = max(ranked)
    return Match(tuple(ranked[best]), best[0])


def ask_node(node_id: int) -> Script[Found]:
    """Read the identity of a node; the first time-out ends it."""
    node = Found(node_id)
    for name, index, sub in NUMBERS:
        reply = yield Request(index, sub)
        if reply.is_silent:
            return node
        node.answers = True
        node.numbers[name] = None if reply.abort else int.from_bytes(reply.data, "little")
    reply = yield Request(cia.ERROR_REGISTER, 0)
    if not reply.abort and reply.data:
        node.error_register = reply.data[0]
    for name, index in TEXTS:
        reply = yield Request(index, 0)
        if not reply.abort:
            node.texts[name] = reply.data.decode("latin-1").rstrip("\0")
    return node


class Scanner(Core):
    """A core that looks for nodes and then asks its host to stop; it changes nothing on the bus."""

    cob_ids: frozenset[int] | None = frozenset()

    def __init__(self, node_ids: Sequence[int] = range(1, cia.MAX_NODE_ID + 1)) -> None:
        self.nodes: dict[int, Found] = {}
        """What was found, by node-ID."""
        self.has_unconfigured = False
        """Whether a node without node-ID has answered."""
        self.other_master = OtherMaster()
        self._node_ids = tuple(node_ids)
        self._end_ns = NEVER
        self._sessions: Sessions[Found] = Sessions()
        self._states: dict[int, cia.NmtState | None] = {}
        self._started = False
        answers = [base + n for n in self._node_ids for base in (cia.SDO_SERVER_BASE, cia.HEARTBEAT_BASE)]
        self.cob_ids = frozenset(answers) | {cia.LSS_SLAVE_ID} | OtherMaster.cob_ids

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Take frames up to now; return frames to send, events, and the time of the next wake-up."""
        out: list[Frame] = []
        if not self._started:
            self._started = True
            self._end_ns = now_ns + LISTEN_NS
            out.append(lss_request(Lss.IDENTIFY_UNCONFIGURED))
            for node_id in self._node_ids:
                out += self._sessions.begin(now_ns, node_id, node_id, ask_node(node_id))
        answers: dict[int, list[Frame]] = {}
        for frame in frames:
            self._take(frame, answers)
        self.other_master.step(now_ns, frames)
        requests, ended = self._sessions.step(now_ns, answers)
        out += requests
        for node_id, node in ended:
            if node.answers:
                self.nodes[node_id] = node
        if len(self._sessions) == 0 and now_ns >= self._end_ns:
            self._conclude()
            return Step(out, [Event(t_ns=now_ns, kind=EventKind.STOP)], NEVER)
        return Step(out, (), min(self._sessions.wake_ns, self._end_ns if now_ns < self._end_ns else NEVER))

    def _take(self, frame: Frame, answers: dict[int, list[Frame]]) -> None:
        can_id, data = frame.can_id, frame.data
        node_id = can_id & 0x7F
        if can_id == cia.LSS_SLAVE_ID:
            self.has_unconfigured |= data[:1] == bytes([Lss.UNCONFIGURED_IDENTIFIED])
        elif can_id == cia.SDO_SERVER_BASE + node_id:
            answers.setdefault(node_id, []).append(frame)
        elif len(data) == 1:
            value = data[0] & 0x7F
            known = value in cia.NmtState.__members__.values()
            self._states[node_id] = cia.NmtState(value) if known else None

    def _conclude(self) -> None:
        """Put states and answers together."""
        for node_id, state in self._states.items():
            self.nodes.setdefault(node_id, Found(node_id)).state = state
