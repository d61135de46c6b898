"""The dialogue that finds which board sits at which place: pressures and answers in, lines to show out.

A person presses the centre of each place; the board that is pressed belongs there. A press that does not fit
what was asked for is named and asked for again; nothing is guessed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from skinbus.master.commissioning.press_dialogue import HELP, Board, HandPress, PressDialogue

CENTRE = 0.2
"""Part of the smaller side of a board within which its centre is."""


class Place(NamedTuple):
    """A place of the arm file."""

    key: str
    """Of its table, as ``Mounting.key``."""
    label: str
    """Where it is, in words."""
    kind: tuple[int, ...]
    size: tuple[float, float]
    """m"""


class Identified(NamedTuple):
    """The board that was found at a place."""

    node_id: int
    identity: tuple[int, ...]


class Identification(PressDialogue):
    """The dialogue.

    Args:
        places: in the order in which they are asked for.
        boards: those on the bus; the pressures are theirs, in this order.
        found: what an earlier dialogue has found, by the key of the place.
    """

    def __init__(
        self, places: Sequence[Place], boards: Sequence[Board], found: dict[str, Identified] | None = None
    ) -> None:
        super().__init__(boards)
        self.places = tuple(places)
        known = {(board.node_id, board.identity) for board in boards}
        keys = {place.key for place in places}
        self.found = {key: old for key, old in (found or {}).items() if key in keys and old in known}
        """By the key of the place, in the order in which they were found."""
        self._skipped: list[str] = []

    def missing(self) -> list[Place]:
        """Return the places at which no board was found."""
        return [place for place in self.places if place.key not in self.found]

    def summary(self) -> list[str]:
        """Return what was found, place by place."""
        lines = []
        for k, place in enumerate(self.places, 1):
            said = "left out" if place.key in self._skipped else "-"
            if own := self.found.get(place.key):
                said = f"node {own.node_id}"
            lines.append(f"  {k:3}  {place.label}: {said}")
        return lines

    def greet(self) -> list[str]:
        """Return what is said first."""
        known = [f"{len(self.found)} of {len(self.places)} places are known from before."] * bool(self.found)
        return [*known, f"Press with a finger for a second, let go, and wait for the next line. {HELP}."]

    @property
    def _next(self) -> Place | None:
        """The place that is asked for."""
        return next((place for place in self.missing() if place.key not in self._skipped), None)

    def ask(self) -> str:
        """Return what is asked for: the centre of a place."""
        place = self._next
        self.is_complete = place is None
        if place is None:
            return "All places have been asked for. Type done to write the arm file, undo, or list."
        return f"[{self.places.index(place) + 1}/{len(self.places)}] {place.label}: press the centre."

    def skip(self) -> list[str]:
        """Leave out the place that is asked for."""
        place = self._next
        if place is None:
            return []
        self._skipped.append(place.key)
        return [f"Left out: {place.label}."]

    def undo(self) -> list[str]:
        """Take back the last press, or all that was left out."""
        if self.found:
            key, _ = self.found.popitem()
            return [f"Taken back: {place.label}." for place in self.places if place.key == key]
        said = [] if self._skipped else ["There is nothing to take back."]
        self._skipped.clear()
        return said

    def take(self, press: HandPress) -> str:
        """Note the board that sits at the place, or return what is wrong with the press."""
        place, board, off = self._next, self.boards[press.board], abs(press.places[press.board])
        assert place is not None
        if press.others:
            nodes = ", ".join(str(self.boards[b].node_id) for b in (press.board, *press.others))
            return f"More than one board was pressed (nodes {nodes}): press one, away from its edges."
        for other in self.places:
            if other.key in self.found and self.found[other.key].node_id == board.node_id:
                return f"Node {board.node_id} was pressed, which is at {other.label}; if not, type undo."
        if board.kind != place.kind:
            return f"Node {board.node_id} is another kind of board than the arm file has at {place.label}."
        if off > CENTRE * min(place.size):
            return f"Node {board.node_id} was pressed {1e3 * off:.0f} mm from its centre."
        self.found[place.key] = Identified(board.node_id, board.identity)
        return f"{place.label}: node {board.node_id}"
