"""The contacts that two masters published from the same readings, held against each other cycle by cycle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.can.frame import Frame
from skinbus.model import Arm
from skinbus.objects import cia
from skinbus.objects.contacts import PAYLOAD, ContactColumns, ContactState, unpack_contacts
from skinbus.objects.profile import MASTER_NODE_ID
from skinbus.skin.listener import Listener

NEAR_M: Final = 10e-3
"""Contacts of the two this near are one: half of the distance at which two fingers are separated."""


AFTER_CONTACTS: Final = (cia.SYNC_ID, cia.NMT_COMMAND_ID)
"""What a master sends when the contacts of a cycle are out: the next SYNC, or its final_frames."""


@dataclass(frozen=True, slots=True)
class PublishedCycle:
    """What a master published of one cycle: TPDOs of contacts by slot."""

    t_ns: int
    counter: int
    flags: int
    payloads: dict[int, bytes] = field(default_factory=dict)


class PublishedCycles:
    """Sorts the frames of a master into cycles; the summary of a cycle comes before its contacts."""

    def __init__(self, node_id: int) -> None:
        listener = Listener(node_id)
        self._slot_of, self._summary_id = listener.slot_of, listener.summary_id
        self._open: PublishedCycle | None = None
        self._is_whole = False

    def take(self, frame: Frame) -> PublishedCycle | None:
        """Take a frame; return the cycle that has ended with it, if one has."""
        if frame.flags:
            return None
        if frame.can_id == self._summary_id and len(frame.data) == PAYLOAD.itemsize:
            ended, self._open = self._open, PublishedCycle(frame.t_ns, frame.data[0], frame.data[3])
            self._is_whole = False
            return ended
        self._is_whole |= frame.can_id in AFTER_CONTACTS
        slot = self._slot_of.get(frame.can_id)
        if self._open and slot is not None and _tells_of_contact(frame.data):
            self._open.payloads.setdefault(slot, frame.data)  # a second one is for late listeners
        return None

    def end(self, *, cut: bool = False) -> PublishedCycle | None:
        """Return the last cycle; one that may have been ``cut`` short only if it is known not to be."""
        ended, self._open = self._open, None
        return ended if self._is_whole or not cut else None


@dataclass(slots=True)
class Differences:
    """What came of the comparison."""

    n_same: int = 0
    """Cycles whose contacts are the same to the byte, but perhaps for their ids."""
    n_renumbered: int = 0
    """Of these, those with other ids or objects: one of the masters had begun earlier."""
    n_different: int = 0
    n_flagged: int = 0
    """Of these, those in which the master in the recording had a reason that it reported."""
    n_recorded_only: int = 0
    """Cycles that only the recording has."""
    n_made_only: int = 0
    first_ns: int | None = None
    """When the first cycle that is different was made."""
    largest_m: float = 0.0
    """Between two contacts that are one."""
    largest_n: float = 0.0
    """Of their forces, N."""
    n_states: int = 0
    """Contacts that are one, and in two states, summed over cycles."""
    n_missing: int = 0
    """Contacts that only the recording has, summed over cycles."""
    n_new: int = 0


class Comparison:
    """Holds what was recorded of a master against what is made now."""

    def __init__(
        self,
        arm: Arm,
        node_id: int = MASTER_NODE_ID,
        *,
        bus: int = 0,
        counts: Callable[[int], bool] = lambda t_ns: True,
        reasons: int = 0,
    ) -> None:
        """Begin.

        node_id: of both masters
        bus:     whose frames are looked at; contacts are published on all
        counts:  whether a cycle of this time is compared
        reasons: bits of "Cycle flags" that explain why contacts differ
        """
        self.found = Differences()
        self._arm = arm
        self._bus = bus
        self._counts = counts
        self._reasons = reasons
        self._recorded = PublishedCycles(node_id)
        self._made = PublishedCycles(node_id)
        self._waiting: tuple[dict[int, PublishedCycle], dict[int, PublishedCycle]] = ({}, {})

    def take_recorded(self, frame: Frame) -> None:
        """Take a frame of the recording."""
        if frame.bus == self._bus:
            self._add(0, self._recorded.take(frame))

    def take_made(self, t_ns: int, frames: Sequence[Frame]) -> None:
        """Take frames that the master sends of a cycle that began at ``t_ns``."""
        for frame in frames:
            if frame.bus == self._bus:
                self._add(1, self._made.take(frame._replace(t_ns=t_ns)))

    def end(self) -> Differences:
        """Compare what is left; return what was found."""
        self._add(0, self._recorded.end(cut=True))
        self._add(1, self._made.end())
        for whose, cycles in enumerate(self._waiting):
            for cycle in cycles.values():
                self._leave_alone(whose, cycle)
        return self.found

    def _add(self, whose: int, cycle: PublishedCycle | None) -> None:
        """Pair a cycle with that of the other by its SYNC counter, or let it wait."""
        if cycle is None:
            return
        other = self._waiting[1 - whose].pop(cycle.counter, None)
        if other is not None:
            self._compare(*((cycle, other) if whose == 0 else (other, cycle)))
            return
        if (old := self._waiting[whose].get(cycle.counter)) is not None:  # the counter has been all round
            self._leave_alone(whose, old)
        self._waiting[whose][cycle.counter] = cycle

    def _leave_alone(self, whose: int, cycle: PublishedCycle) -> None:
        """Count a cycle that the other does not have."""
        if not self._counts(cycle.t_ns):
            return
        if whose == 0:
            self.found.n_recorded_only += 1
        else:
            self.found.n_made_only += 1

    def _compare(self, recorded: PublishedCycle, made: PublishedCycle) -> None:
        found = self.found
        if not self._counts(made.t_ns):
            return
        if _without_ids(recorded) == _without_ids(made):
            found.n_same += 1
            found.n_renumbered += recorded.payloads != made.payloads
            return
        found.n_different += 1
        found.n_flagged += bool(recorded.flags & self._reasons)
        if found.first_ns is None:
            found.first_ns = made.t_ns
        there, here = _columns(recorded), _columns(made)
        distance = self._distances(there, here)
        n_pairs = 0
        while distance.size and (nearest := distance.min()) <= NEAR_M:
            i, k = np.unravel_index(distance.argmin(), distance.shape)
            distance[i, :] = distance[:, k] = np.inf
            found.largest_m = max(found.largest_m, float(nearest))
            found.largest_n = max(found.largest_n, float(abs(there.force[i] - here.force[k])))
            found.n_states += bool(there.state[i] != here.state[k])
            n_pairs += 1
        found.n_missing += len(there.id) - n_pairs
        found.n_new += len(here.id) - n_pairs

    def _distances(self, there: ContactColumns, here: ContactColumns) -> npt.NDArray[np.float64]:
        """Return how far each contact is from each other, on the chart of their link, m; inf across links."""
        distance = np.full((len(there.id), len(here.id)), np.inf)
        for number, link in enumerate(self._arm.links):
            i, k = np.flatnonzero(there.link == number), np.flatnonzero(here.link == number)
            distance[np.ix_(i, k)] = link.surface.distance(
                there.s[i, None], there.a[i, None], here.s[k], here.a[k]
            )
        return distance


def _tells_of_contact(data: bytes) -> bool:
    return len(data) == PAYLOAD.itemsize and data[1] >> 4 != ContactState.NONE


def _without_ids(cycle: PublishedCycle) -> list[bytes]:
    return sorted(payload[1:] for payload in cycle.payloads.values())


def _columns(cycle: PublishedCycle) -> ContactColumns:
    return unpack_contacts(b"".join(cycle.payloads.values()))
