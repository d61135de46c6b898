"""Scan of a bus: the identity of every node-ID is read, side by side; heartbeats report the states.

A node that answers no SDO but sends heartbeats is found too: it is stopped, or not a full CANopen device.
Nodes without node-ID are detected; LSS can find them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from skinbus.can.frame import Frame
from skinbus.master.commissioning.sessions import NodesCore, Request, Script
from skinbus.master.patches.provisioning import NUMBERS, Identity
from skinbus.node.lss import Lss, lss_request
from skinbus.objects import cia

LISTEN_NS = 1_100_000_000
"""Heartbeats are waited for so long: their usual periods are 1 s and less."""


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
    name: str = "-"
    """Of the device (0x1008), if it has one."""
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
    seen = node.numbers
    ranked = [
        ((wanted.revision in (0, seen.get("revision")), wanted.serial != 0), name)
        for name, wanted in candidates
        if (wanted.vendor, wanted.product) == (seen.get("vendor"), seen.get("product"))
        and wanted.device_type in (0, seen.get("device_type"))
        and wanted.serial in (0, seen.get("serial"))
    ]
    best = max(ranked, default=((False, False), ""))[0]
    return Match(tuple(name for rank, name in ranked if rank == best), best[0])


class Scanner(NodesCore[None]):
    """A core that looks for nodes and then asks its host to stop; it changes nothing on the bus."""

    def __init__(self, node_ids: Sequence[int] = range(1, cia.MAX_NODE_ID + 1)) -> None:
        super().__init__(node_ids, lasts_ns=LISTEN_NS)
        self.has_unconfigured = False
        """Whether a node without node-ID has answered."""
        self._all = {node_id: Found(node_id) for node_id in node_ids}
        self._heard: set[int] = set()
        self.cob_ids = frozenset({*self._node_of, *self.other_master.cob_ids, cia.LSS_SLAVE_ID})

    @property
    def nodes(self) -> dict[int, Found]:
        """What was found, by node-ID."""
        return {n: node for n, node in self._all.items() if node.answers or n in self._heard}

    def _first(self) -> list[Frame]:
        return [lss_request(Lss.IDENTIFY_UNCONFIGURED)]

    def _script(self, node_id: int) -> Script[None]:
        """Read the identity of a node; the first time-out ends it."""
        node = self._all[node_id]
        for name, index, sub in NUMBERS:
            reply = yield Request(index, sub)
            if reply.is_silent:
                return
            node.answers = True
            node.numbers[name] = None if reply.abort else int.from_bytes(reply.data, "little")
        reply = yield Request(cia.ERROR_REGISTER, 0)
        if not reply.abort and reply.data:
            node.error_register = reply.data[0]
        reply = yield Request(cia.DEVICE_NAME, 0)
        if not reply.abort:
            node.name = reply.data.decode("latin-1").rstrip("\0")

    def _hear(self, frame: Frame) -> None:
        can_id, data, node_id = frame.can_id, frame.data, frame.can_id & 0x7F
        if can_id == cia.LSS_SLAVE_ID:
            self.has_unconfigured |= data[:1] == bytes([Lss.UNCONFIGURED_IDENTIFIED])
        elif can_id in self._node_of and can_id & ~0x7F == cia.HEARTBEAT_BASE and len(data) == 1:
            self._heard.add(node_id)
            state = data[0] & 0x7F
            self._all[node_id].state = cia.NmtState(state) if state in list(cia.NmtState) else None
