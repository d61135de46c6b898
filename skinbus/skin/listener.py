"""A listener that needs only skin-master.eds: the master's TPDOs as cycles with their contacts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from skinbus.arrays import Ints
from skinbus.can.frame import Frame
from skinbus.objects import profile
from skinbus.objects.contacts import PAYLOAD, ContactState
from skinbus.objects.published import usual
from skinbus.skin.contact import Records


class Summary(NamedTuple):
    """The summary TPDO."""

    t_ns: int
    data: bytes

    @property
    def latency_us(self) -> int:
        """From the SYNC to the contacts."""
        return 10 * int.from_bytes(self.data[6:8], "little")


class Heard(NamedTuple):
    """A cycle of a master: its summary and contacts; those that have gone are there once, with state LIFT."""

    summary: Summary
    slots: Ints
    """(n,) of the contacts, growing."""
    contacts: Records
    """(n,) of PAYLOAD."""


class Listener:
    """Gathers the cycles of a master."""

    def __init__(self, node_id: int = profile.MASTER_NODE_ID) -> None:
        objects = usual(node_id)
        self._slot_of = {cob_id: slot for slot, cob_id in enumerate(objects.contact_ids)}
        self._summary_id = objects.summary.cob_id
        self.cob_ids = frozenset(self._slot_of) | {self._summary_id}
        """Identifiers that it takes."""
        self._open: Summary | None = None
        self._came: dict[int, bytes] = {}
        """Contacts of the open cycle, and ..."""
        self._there: dict[int, bytes] = {}
        """... those that were there in the cycle before, by slot."""
        self.n_summaries = 0

    def take(self, now_ns: int, frame: Frame) -> Iterator[Heard]:
        """Take a frame; return the cycles that it ends.

        A summary begins a cycle and its contacts follow: those seen, and the end of those before it. Where a
        frame was lost the cycle ends with the next summary, and a contact is as it was.
        """
        data, slot = frame.data, self._slot_of.get(frame.can_id)
        if len(data) != PAYLOAD.itemsize:
            return
        if frame.can_id == self._summary_id:
            if self._open:
                yield self._end_cycle(self._open)
            self._open = Summary(now_ns, data)
            self.n_summaries += 1
        elif (
            slot is not None and self._open and _state(data) <= max(ContactState)
        ):  # states of another profile are left out
            self._came[slot] = data
        if self._open and self._is_complete(self._open):
            yield self._end_cycle(self._open)

    def _is_complete(self, summary: Summary) -> bool:
        n_seen = sum(_state(data) in (ContactState.TOUCH, ContactState.HELD) for data in self._came.values())
        is_all = n_seen == min(summary.data[1], profile.MAX_CONTACTS)
        return is_all and self._there.keys() <= self._came.keys()

    def _end_cycle(self, summary: Summary) -> Heard:
        every = sorted((self._there | self._came).items())
        shown = [(slot, data) for slot, data in every if _state(data) != ContactState.NONE]
        self._open, self._came = None, {}
        self._there = {slot: data for slot, data in shown if _state(data) != ContactState.LIFT}
        contacts = np.frombuffer(b"".join(data for _, data in shown), PAYLOAD)
        return Heard(summary, np.array([slot for slot, _ in shown], np.int64), contacts)


def _state(data: bytes) -> int:
    """Return the state in the TPDO of a contact."""
    return data[1] >> 4
