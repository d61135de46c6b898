"""Events between cycles: a contact that is new, begins to move, was lifted or lost; each is found once."""

from __future__ import annotations

from typing import Final, Literal

from skinbus.estimate import TrackState
from skinbus.skin.cycle import Contact, Cycle, PatchState

Kind = Literal["touch", "move", "lift", "lost"]
KINDS: tuple[Kind, ...] = ("touch", "move", "lift", "lost")

UNSEEN_S: Final = 0.5
"""A contact that is not seen for so long has no readings, s: half of the time after which it ends for that;
one that readings do not show ends within a cycle or two, unless another contact hides it; ..."""
UNSEEN_PERIODS: Final = 2.5
"""... at low rates so many periods: half a period more than a cycle or two."""
STALE_PERIODS: Final = 1.5
"""Readings older than so many periods at the SYNC of a cycle are not of the cycle before it."""


class TouchEvents:
    """Finds the events of cycles that follow each other, also where some between them were lost.

    ::

        touch  an id that was not there in the cycle before
        move   state MOVE, and the state before was another
        lift   an id is not there any more, or has state LIFT, or is that of another contact now
        lost   as lift, but it has ended because readings of its link are missing: nothing shows a release
    """

    def __init__(self) -> None:
        self._there: dict[int, Contact] = {}

    def step(self, cycle: Cycle) -> list[tuple[Kind, Contact]]:
        """Return the events of a cycle; a contact that has gone is as it was last, with state LIFT."""
        events: list[tuple[Kind, Contact]] = []
        there = {contact.id: contact for contact in cycle.contacts if contact.state is not TrackState.LIFT}
        for key, before in self._there.items():
            if key not in there or not _is_same(before, there[key]):
                kind: Kind = "lost" if key not in there and _is_lost(before, cycle) else "lift"
                events.append((kind, before.lifted()))
        for key, contact in there.items():
            known = self._there.get(key)
            if known is None or not _is_same(known, contact):
                events.append(("touch", contact))
                known = None
            if contact.state is TrackState.MOVE and (known is None or known.state is not TrackState.MOVE):
                events.append(("move", contact))
        self._there = there
        return events


def _is_lost(contact: Contact, cycle: Cycle) -> bool:
    """Whether a contact that has ended in a cycle had no readings that could have shown it."""
    period_ns = cycle.layout.period_ns
    unseen_ns = cycle.t_ns - contact.seen_ns
    if contact.state is not TrackState.COAST or unseen_ns < max(1e9 * UNSEEN_S, UNSEEN_PERIODS * period_ns):
        return False
    return any(
        patch.state is not PatchState.OPERATIONAL
        or cycle.t_ns - patch.last_fresh_ns > STALE_PERIODS * period_ns
        for patch in cycle.patches
        if patch.link == contact.link
    )


def _is_same(before: Contact, now: Contact) -> bool:
    """Whether two contacts with one id are one; where identities are not known, a new one has state TOUCH."""
    if before.identity or now.identity:
        return before.identity == now.identity
    return now.state is not TrackState.TOUCH or before.state is TrackState.TOUCH
