"""A listener that needs only skin-master.eds: the master's TPDOs as rows of contacts."""

from __future__ import annotations

from collections.abc import Iterator
from struct import Struct
from typing import Final, NamedTuple

from skinbus.can.frame import Frame
from skinbus.master.level_control import CycleFlags, split_flags
from skinbus.objects import profile
from skinbus.objects.contacts import FORCE_STEP, LENGTH_STEP, ContactState
from skinbus.objects.published import usual

_PAYLOAD: Final = Struct("<BBhhH")
"""A contact: id, link and state, s, a, force."""


class ContactRow(NamedTuple):
    """One contact as its TPDO says it: SI units."""

    slot: int
    id: int
    link: int
    state: ContactState
    s: float
    a: float
    force: float
    t_ns: int


class Summary(NamedTuple):
    """The summary TPDO."""

    counter: int
    n_contacts: int
    flags: CycleFlags
    level: str | None
    """None where the master does not say."""
    latency_us: int
    t_ns: int


class Heard(NamedTuple):
    """A cycle of a master."""

    summary: Summary
    rows: list[ContactRow]
    """By slot; those that have gone are there once, with state LIFT."""


class Listener:
    """Gathers the cycles of a master."""

    def __init__(self, node_id: int = profile.MASTER_NODE_ID) -> None:
        objects = usual(node_id)
        self._slot_of = {cob_id: slot for slot, cob_id in enumerate(objects.contact_ids)}
        self._summary_id = objects.summary.cob_id
        self.cob_ids = frozenset(self._slot_of) | {self._summary_id}
        """Identifiers that it takes."""
        self._open: Summary | None = None
        self._came: dict[int, ContactRow] = {}
        """Contacts of the open cycle, and ..."""
        self._there: dict[int, ContactRow] = {}
        """... those that were there in the cycle before, by slot."""
        self.n_summaries = 0

    def take(self, now_ns: int, frame: Frame) -> Iterator[Heard]:
        """Take a frame; return the cycles that it ends.

        A summary begins a cycle and its contacts follow: those seen, and the end of those before it. Where a
        frame was lost the cycle ends with the next summary, and a contact is as it was.
        """
        slot = self._slot_of.get(frame.can_id)
        if slot is not None and len(frame.data) == _PAYLOAD.size:
            self._take_contact(now_ns, slot, frame.data)
        elif frame.can_id == self._summary_id and len(frame.data) == 8:
            if self._open:
                yield self._end_cycle(self._open)
            self._open = _summary(now_ns, frame.data)
            self.n_summaries += 1
        if self._open and self._is_complete(self._open):
            yield self._end_cycle(self._open)

    def _is_complete(self, summary: Summary) -> bool:
        n_seen = sum(row.state in (ContactState.TOUCH, ContactState.HELD) for row in self._came.values())
        is_all = n_seen == min(summary.n_contacts, profile.MAX_CONTACTS)
        return is_all and self._there.keys() <= self._came.keys()

    def _end_cycle(self, summary: Summary) -> Heard:
        rows = [row for _, row in sorted((self._there | self._came).items())]
        self._open, self._came = None, {}
        self._there = {
            row.slot: row for row in rows if row.state not in (ContactState.LIFT, ContactState.NONE)
        }
        return Heard(summary, [row for row in rows if row.state is not ContactState.NONE])

    def _take_contact(self, now_ns: int, slot: int, data: bytes) -> None:
        id, link_state, s, a, force = _PAYLOAD.unpack(data)
        if link_state >> 4 <= max(ContactState):  # states of another profile are left out
            state, place = ContactState(link_state >> 4), (s * LENGTH_STEP, a * LENGTH_STEP)
            if self._open:
                self._came[slot] = ContactRow(
                    slot, id, link_state & 0xF, state, *place, force * FORCE_STEP, now_ns
                )


def _summary(now_ns: int, data: bytes) -> Summary:
    latency_us = 10 * int.from_bytes(data[6:8], "little")
    return Summary(data[0], data[1], *split_flags(data[3]), latency_us, now_ns)
