"""The dialogue that finds which board sits at which place: pressures and answers in, lines to show out.

A person presses the centre of each place; the board that is pressed belongs there. A press that does not fit
what was asked for is named and asked for again; nothing is guessed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skinbus.arrays import Floats
from skinbus.printable import printable

HOLD_NS = 300_000_000
"""A press shorter than this is a slip: people who mean it hold for half a second."""
RELEASED_NS = 150_000_000
"""Nothing pressed for so long ends a press; a hand that shakes leaves for less."""
STUCK_NS = 10_000_000_000
"""A board pressed for so long is pressed by something else than a hand, a cable tie say: that is its zero."""
FOLLOW = 0.05
"""Part of the way to what is read that a zero goes in a cycle: slow against noise, fast against drift."""
FALL = 0.5
"""The same below the zero, and the thresholds below it from which it does."""
LIT = 1.5
"""Thresholds above its zero at which a tactel is pressed; the zero has the noise of a reading at first."""
LIGHT = 3.0
"""Thresholds that the strongest tactel has to read: below, the noise of its neighbours moves the centre."""
STRONG = 0.7
"""Part of the greatest strength from which a cycle counts."""
SECOND = 0.5
"""Part of the strength of a board from which another one that is pressed too counts as pressed."""
CENTRE = 0.2
"""Part of the smaller side of a board within which its centre is."""

SHORT = "was touched too shortly: hold for a second"
TOO_LIGHT = "was pressed too lightly: press harder"
STUCK = "is pressed without end: what it reads now is its zero"

HELP = (
    "Press for a second where the next line says, let go, and wait for the next line. undo: take back the "
    "last press; skip: leave this place out, as where no press is felt; done: that is enough; quit: stop."
)


class Board(NamedTuple):
    """A board on the bus that may be pressed."""

    node_id: int
    kind: tuple[int, ...]
    """Device type, vendor and product: places take boards of their kind."""
    uv: Floats
    """(n_tactels, 2) m"""
    threshold: float
    """Pa"""
    serial: int = 0
    """Number; 0 of a board that has none."""


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
    serial: int


class HandPress(NamedTuple):
    """One press, when it has ended."""

    board: int
    """The one that is pressed most."""
    others: list[int]
    """Those that are pressed nearly as much."""
    off: float
    """m, from the centre of the board."""
    flaw: str
    """What is wrong with it, whatever was asked for, as it is said of its node."""


class PressDetector:
    """Finds presses in the pressures of boards, cycle by cycle."""

    def __init__(self, boards: Sequence[Board]) -> None:
        self._sizes = [len(board.uv) for board in boards]
        self._starts = np.cumsum([0, *self._sizes[:-1]])
        self._at = np.concatenate([board.uv for board in boards]) @ np.array([1.0, 1j])
        self._threshold = np.repeat([board.threshold for board in boards], self._sizes)
        self._zero = np.full(len(self._at), np.nan)
        self._first_ns = self._last_ns = 0
        self._rows: list[tuple[float, Floats]] = []

    def step(self, now_ns: int, pressures: Floats) -> HandPress | None:
        """Take the pressures (n_tactels,) Pa of a cycle; return the press that has ended with it.

        Zeros are not subtracted yet; what was not read is NaN.
        """
        self._zero = np.where(np.isnan(self._zero), pressures, self._zero)
        p = np.nan_to_num(pressures - self._zero, nan=0.0)
        is_lit = np.maximum.reduceat(p / self._threshold, self._starts) > LIT
        is_free = ~np.repeat(is_lit, self._sizes)
        self._zero += is_free * np.where(p < -FALL * self._threshold, FALL, FOLLOW) * p
        if is_lit.any():
            self._first_ns = self._first_ns if self._rows else now_ns
            self._last_ns = now_ns
            self._rows.append((float(np.maximum(p, 0.0)[~is_free].sum()), p))
        is_stuck = now_ns - self._first_ns >= STUCK_NS and is_lit.any()
        is_over = is_stuck or now_ns - self._last_ns >= RELEASED_NS
        if not (self._rows and is_over):
            return None
        if is_stuck:
            self._zero += ~is_free * p
        is_short = self._last_ns - self._first_ns < HOLD_NS
        press = self._press(STUCK if is_stuck else SHORT if is_short else "")
        self._rows = []
        return press

    def _press(self, flaw: str) -> HandPress | None:
        """Return the press under way; None if it was short and light: noise, or a sleeve."""
        strengths = np.array([strength for strength, _ in self._rows])
        is_held = strengths >= STRONG * strengths.max()
        mean = np.array([p for _, p in self._rows])[is_held].mean(axis=0)
        share = np.where(mean > 0.5 * self._threshold, mean, 0.0)  # what is less is noise, and pulls inwards
        strength = np.add.reduceat(share, self._starts)
        board = int(strength.argmax())
        here = slice(self._starts[board], self._starts[board] + self._sizes[board])
        if (mean[here] / self._threshold[here]).max() < LIGHT:
            if flaw is SHORT:
                return None
            flaw = flaw or TOO_LIGHT
        others = [b for b in np.flatnonzero(strength > SECOND * strength[board]).tolist() if b != board]
        weight = np.maximum(mean[here], 0.0)
        off = abs(weight @ self._at[here]) / max(float(weight.sum()), 1e-300)
        return HandPress(board, others, float(off), flaw)


class Identification:
    """The dialogue. Whatever is said, the question follows.

    It is over when no place is left to press, or as ``done`` and ``quit`` say.

    Args:
        places: in the order in which they are asked for.
        boards: those on the bus; the pressures are theirs, in this order.
    """

    def __init__(self, places: Sequence[Place], boards: Sequence[Board]) -> None:
        self.places, self.boards = tuple(places), tuple(boards)
        self.is_over = self.is_quit = False
        self._detector = PressDetector(boards)
        self._has_begun = False
        self._answers: list[Identified | None] = []
        """Of the first places; None for one that was left out."""

    @property
    def found(self) -> dict[str, Identified]:
        """The boards that were found, by the key of the place."""
        pairs = zip(self.places, self._answers, strict=False)
        return {place.key: own for place, own in pairs if own is not None}

    def step(self, now_ns: int, pressures: Floats, answers: Sequence[str] = ()) -> list[str]:
        """Take the pressures (n_tactels,) Pa of a cycle and lines that were typed; return lines to show."""
        lines: list[str] = [] if self._has_begun else [HELP, self._ask()]
        self._has_begun = True
        for answer in answers:
            if not self.is_over:
                lines += self._answer(answer.strip())
        press = self._detector.step(now_ns, pressures)
        if press is not None and not self.is_over:
            lines += [self._take(press), self._ask()]
        return lines

    def _ask(self) -> str:
        """Return what is asked for: the centre of a place."""
        k = len(self._answers)
        self.is_over = k == len(self.places)
        if self.is_over:
            return "All places have been asked for."
        return f"[{k + 1}/{len(self.places)}] {self.places[k].label}: press the centre."

    def _answer(self, word: str) -> list[str]:
        """Do what was typed."""
        if word in ("quit", "done"):
            self.is_over, self.is_quit = True, word == "quit"
            return []
        if word == "skip":
            self._answers.append(None)
            said = [f"Left out: {self.places[len(self._answers) - 1].label}."]
        elif word == "undo" and self._answers:
            self._answers.pop()
            said = [f"Taken back: {self.places[len(self._answers)].label}."]
        elif word == "undo":
            said = ["There is nothing to take back."]
        else:
            said = [f"{printable(word, limit=40)!r} is no answer here. {HELP}"] if word else []
        return [*said, self._ask()]

    def _take(self, press: HandPress) -> str:
        """Note the board that sits at the place, or return what is wrong with the press."""
        place, board = self.places[len(self._answers)], self.boards[press.board]
        own = Identified(board.node_id, board.serial)
        if press.flaw:
            return f"Node {board.node_id} {press.flaw}."
        if press.others:
            nodes = ", ".join(str(self.boards[b].node_id) for b in (press.board, *press.others))
            return f"More than one board was pressed (nodes {nodes}): press one, away from its edges."
        if own in self._answers:
            other = self.places[self._answers.index(own)].label
            return f"Node {board.node_id} was pressed, which is at {other}; if not, type undo."
        if board.kind != place.kind:
            return f"Node {board.node_id} is another kind of board than the arm file has at {place.label}."
        if press.off > CENTRE * min(place.size):
            return f"Node {board.node_id} was pressed {1e3 * press.off:.0f} mm from its centre."
        self._answers.append(own)
        return f"{place.label}: node {board.node_id}"
