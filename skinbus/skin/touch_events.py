"""Events between cycles: a contact that is new, begins to move, or has gone; each is found once."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from skinbus.estimate import TrackState
from skinbus.skin.cycle import Contact, Cycle

Kind = Literal["touch", "move", "lift"]
KINDS: tuple[Kind, ...] = ("touch", "move", "lift")


class TouchEvents:
    """Finds the events of cycles that follow each other, also where some between them were lost.

    ::

        touch  an id that was not there in the cycle before
        move   state MOVE, and the state before was another
        lift   an id is not there any more, or has state LIFT, or is that of another contact now
    """

    def __init__(self) -> None:
        self._there: dict[int, Contact] = {}

    def step(self, cycle: Cycle) -> list[tuple[Kind, Contact]]:
        """Return the events of a cycle; a contact that has gone is as it was last, with state LIFT."""
        events: list[tuple[Kind, Contact]] = []
        there = {contact.id: contact for contact in cycle.contacts if contact.state is not TrackState.LIFT}
        for key, before in self._there.items():
            if key not in there or not _is_same(before, there[key]):
                events.append(("lift", replace(before, state=TrackState.LIFT, force=0.0)))
        for key, contact in there.items():
            known = self._there.get(key)
            if known is None or not _is_same(known, contact):
                events.append(("touch", contact))
                known = None
            if contact.state is TrackState.MOVE and (known is None or known.state is not TrackState.MOVE):
                events.append(("move", contact))
        self._there = there
        return events


def _is_same(before: Contact, now: Contact) -> bool:
    """Whether two contacts with one id are one; where identities are not known, a new one has state TOUCH."""
    if before.identity or now.identity:
        return before.identity == now.identity
    return now.state is not TrackState.TOUCH or before.state is TrackState.TOUCH
