"""The dialogue that finds which board sits at which place: pressures and answers in, lines to show out.

A person presses the centre of each place; the board that is pressed belongs there. A press that does not fit
what was asked for is named and asked for again; nothing is guessed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from skinbus.master.commissioning.press_dialogue import Board, HandPress, PressDialogue

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
    """

    def __init__(self, places: Sequence[Place], boards: Sequence[Board]) -> None:
        super().__init__(boards)
        self.places = tuple(places)
        self._answers: list[Identified | None] = []
        """Of the first places; None for one that was left out."""

    @property
    def found(self) -> dict[str, Identified]:
        """The boards that were found, by the key of the place."""
        pairs = zip(self.places, self._answers, strict=False)
        return {place.key: own for place, own in pairs if own is not None}

    def ask(self) -> str:
        """Return what is asked for: the centre of a place."""
        k = len(self._answers)
        self.is_over = k == len(self.places)
        if self.is_over:
            return "All places have been asked for."
        return f"[{k + 1}/{len(self.places)}] {self.places[k].label}: press the centre."

    def skip(self) -> str:
        """Leave out the place that is asked for."""
        self._answers.append(None)
        return f"Left out: {self.places[len(self._answers) - 1].label}."

    def undo(self) -> str:
        """Take back the last press, or what was left out last."""
        if not self._answers:
            return "There is nothing to take back."
        self._answers.pop()
        return f"Taken back: {self.places[len(self._answers)].label}."

    def take(self, press: HandPress) -> str:
        """Note the board that sits at the place, or return what is wrong with the press."""
        place, board = self.places[len(self._answers)], self.boards[press.board]
        off, own = abs(press.places[press.board]), Identified(board.node_id, board.identity)
        if press.others:
            nodes = ", ".join(str(self.boards[b].node_id) for b in (press.board, *press.others))
            return f"More than one board was pressed (nodes {nodes}): press one, away from its edges."
        if own in self._answers:
            other = self.places[self._answers.index(own)].label
            return f"Node {board.node_id} was pressed, which is at {other}; if not, type undo."
        if board.kind != place.kind:
            return f"Node {board.node_id} is another kind of board than the arm file has at {place.label}."
        if off > CENTRE * min(place.size):
            return f"Node {board.node_id} was pressed {1e3 * off:.0f} mm from its centre."
        self._answers.append(own)
        return f"{place.label}: node {board.node_id}"
