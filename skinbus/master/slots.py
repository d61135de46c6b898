"""Which of the published contact objects shows which contact: a contact keeps its slot while it stays near.

The nearest pairs of slots and contacts go first. A contact that is near no slot gets a free one and a new
identity; identities count from 1 to 255 and skip those in sight.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from skinbus.estimate import Contacts
from skinbus.model import Link

REACH = 0.020
"""A contact further than this from a slot's last place is another one, m: 1 m/s at 50 Hz."""

N_IDS = 255
"""Identities are one byte; 0 is none."""


class Slots:
    """The identities shown by a fixed number of slots, and where their contacts were last."""

    def __init__(self, links: Sequence[Link], n_slots: int) -> None:
        self._links = tuple(links)
        self.id = np.zeros(n_slots, np.int64)
        """(n_slots,) identity shown by a slot, 0 for none."""
        self.is_new = np.zeros(n_slots, np.bool_)
        """(n_slots,) whether the contact of a slot has just appeared."""
        self._link = np.zeros(n_slots, np.int64)
        self._s, self._a = np.zeros(n_slots), np.zeros(n_slots)
        self._last_id = 0

    def assign(self, contacts: Contacts) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Return the contact of each slot (n_slots,), -1 for none, and the slots whose contact has gone."""
        row = np.full(len(self.id), -1, np.intp)
        taken = np.zeros(len(contacts), np.bool_)
        used = np.flatnonzero(self.id)
        d = self._distances(used, contacts)
        for flat in np.argsort(d, axis=None, kind="stable"):
            i, j = divmod(int(flat), len(contacts))
            if d[i, j] > REACH:
                break
            if row[used[i]] < 0 and not taken[j]:
                row[used[i]], taken[j] = j, True
        gone = used[row[used] < 0]
        free = np.flatnonzero(
            self.id == 0
        )  # a slot that has just lost its contact says so before it is used again
        new = np.flatnonzero(~taken)[: len(free)]
        self.id[gone] = 0
        self.is_new[:] = False
        for slot, j in zip(free, new, strict=False):
            row[slot] = j
            self.id[slot] = self._next_id()
            self.is_new[slot] = True
        shown = np.flatnonzero(row >= 0)
        self._link[shown] = contacts.link[row[shown]]
        self._s[shown], self._a[shown] = contacts.s[row[shown]], contacts.a[row[shown]]
        return row, gone

    def _next_id(self) -> int:
        for _ in range(N_IDS):
            self._last_id = self._last_id % N_IDS + 1
            if self._last_id not in self.id:
                break
        return self._last_id

    def _distances(self, used: npt.NDArray[np.intp], contacts: Contacts) -> npt.NDArray[np.float64]:
        """Return distances (n_used, n_contacts) m, infinite between links."""
        d = np.full((len(used), len(contacts)), np.inf)
        for number in np.unique(contacts.link):
            i = np.flatnonzero(self._link[used] == number)
            j = np.flatnonzero(contacts.link == number)
            here = used[i]
            d[np.ix_(i, j)] = self._links[number].surface.distance(
                self._s[here, None], self._a[here, None], contacts.s[j], contacts.a[j]
            )
        return d
