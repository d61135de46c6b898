"""What dialogues with a person who presses boards have in common: lines typed, presses felt, a reminder.

They have no input or output of their own: ``step`` takes pressures and what was typed meanwhile.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from skinbus.estimate.calibration.table import mean_and_noise
from skinbus.printable import printable

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

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
STEADY = 0.05
"""Part of the usual strength of a press by which a cycle may differ and still be one in which it was held."""
SECOND = 0.5
"""Part of the strength of a board from which another one that is pressed too counts as pressed."""


@dataclass(frozen=True, slots=True)
class Board:
    """A board on the bus that may be pressed."""

    node_id: int
    kind: tuple[int, ...]
    """Device type, vendor and product: places take boards of their kind."""
    uv: Floats
    """(n_tactels, 2) m"""
    threshold: float
    """Pa"""
    identity: tuple[int, ...] = (0, 0, 0, 0)
    """Vendor, product, revision, serial number."""


class Flaw(StrEnum):
    """What is wrong with a press, whatever was asked for, as it is said of its node."""

    NONE = ""
    SHORT = "was touched too shortly: hold for a second"
    LIGHT = "was pressed too lightly: press harder"
    STUCK = "is pressed without end: what it reads now is its zero"


@dataclass(frozen=True, slots=True)
class HandPress:
    """One press, when it has ended."""

    board: int
    """The one that is pressed most."""
    others: tuple[int, ...]
    """Those that are pressed nearly as much."""
    places: tuple[complex, ...]
    """By board: u + iv of its centre of pressure, m."""
    strengths: Floats
    """(n_boards,) sums of the pressures, relative to that of the board."""
    readings: Floats
    """(n_tactels,) Pa of all boards while it was held; NaN where nothing was read."""
    noise: Floats
    """(n_tactels,) Pa, what the readings scattered by meanwhile; NaN for less than two."""
    flaw: Flaw

    @property
    def place(self) -> complex:
        """The centre of pressure on the board that is pressed most."""
        return self.places[self.board]


class PressDetector:
    """Finds presses in the pressures of boards, cycle by cycle."""

    def __init__(self, boards: Sequence[Board]) -> None:
        self._boards = tuple(boards)
        self._starts = np.concatenate([[0], np.cumsum([len(board.uv) for board in boards])]).astype(int)
        self._threshold = np.repeat([board.threshold for board in boards], np.diff(self._starts))
        self._zero = np.full(self._starts[-1], np.nan)
        self._begin(0)

    @property
    def is_pressed(self) -> bool:
        """Whether a press is under way."""
        return self._is_open

    def _begin(self, now_ns: int) -> None:
        self._is_open = False
        self._first_ns = self._last_ns = now_ns
        self._strongest = 0.0
        self._rows: list[tuple[float, Floats]] = []

    def step(self, now_ns: int, pressures: Floats) -> HandPress | None:
        """Take the pressures (n_tactels,) Pa of a cycle; return the press that has ended with it.

        Zeros are not subtracted yet; what was not read is NaN.
        """
        is_new = np.isnan(self._zero) & np.isfinite(pressures)
        self._zero[is_new] = pressures[is_new]
        above = pressures - self._zero
        p = np.where(np.isfinite(above), above, 0.0)
        is_lit = np.maximum.reduceat(p / self._threshold, self._starts[:-1]) > LIT
        is_free = ~np.repeat(is_lit, np.diff(self._starts))
        self._zero += is_free * np.where(p < -FALL * self._threshold, FALL, FOLLOW) * p
        if is_lit.any():
            if not self._is_open:
                self._begin(now_ns)
                self._is_open = True
            self._last_ns = now_ns
            strength = float(np.maximum(p, 0.0)[~is_free].sum())
            self._strongest = max(self._strongest, strength)
            self._rows.append((strength, above))
            if now_ns - self._first_ns < STUCK_NS:
                return None
            press = self._press(Flaw.STUCK)
            self._zero += np.where(is_free, 0.0, p)
            self._begin(now_ns)
            return press
        if not self._is_open or now_ns - self._last_ns < RELEASED_NS:
            return None
        is_short = self._last_ns - self._first_ns < HOLD_NS
        press = self._press(Flaw.SHORT if is_short else Flaw.NONE)
        self._begin(now_ns)
        return press

    def _press(self, flaw: Flaw) -> HandPress | None:
        """Return the press under way; None if it was short and light: noise, or a sleeve."""
        strengths = np.array([strength for strength, _ in self._rows])
        rows = np.array([above for _, above in self._rows])
        strong = strengths >= STRONG * self._strongest
        usual = np.quantile(strengths[strong], 0.5, method="lower")
        held = np.abs(strengths / usual - 1.0) < STEADY
        mean = np.nan_to_num(mean_and_noise(rows[strong])[0], nan=0.0)
        share = np.where(mean > 0.5 * self._threshold, mean, 0.0)  # what is less is noise, and pulls inwards
        strength = np.add.reduceat(share, self._starts[:-1])
        board = int(strength.argmax())
        weight = np.maximum(mean, 0.0)
        places = []
        for own, first, last in zip(self._boards, self._starts[:-1], self._starts[1:], strict=True):
            centre = weight[first:last] @ own.uv / max(float(weight[first:last].sum()), 1e-300)
            places.append(complex(*centre))
        peak = mean[self._starts[board] : self._starts[board + 1]].max()
        if peak < LIGHT * self._boards[board].threshold:
            if flaw is Flaw.SHORT:
                return None
            flaw = flaw or Flaw.LIGHT
        strength = strength / max(float(strength[board]), 1e-300)
        others = [b for b in np.flatnonzero(strength > SECOND).tolist() if b != board]
        readings, noise = mean_and_noise(rows[held])
        return HandPress(board, tuple(others), tuple(places), strength, readings, noise, flaw)


REMIND_NS = 20_000_000_000
"""Without a press for so long possible causes are shown, once."""


HELP = (
    "undo: take back the last press; skip: leave this place out; list: what there is; done: that is enough; "
    "quit: go on later"
)


class PressDialogue(ABC):
    """A dialogue about presses on ``boards``, whose pressures it gets, in their order."""

    def __init__(self, boards: Sequence[Board]) -> None:
        self.boards = tuple(boards)
        self.is_over = False
        self.is_complete = False
        """Whether no place is left to press; ``done`` ends the dialogue."""
        self.is_quit = False
        """Whether the rest is left for later."""
        self._detector = PressDetector(boards)
        self._asked_ns: int | None = None
        self._begun = False

    def step(self, now_ns: int, pressures: Floats, answers: Sequence[str] = ()) -> list[str]:
        """Take the pressures (n_tactels,) Pa of a cycle and lines that were typed; return lines to show."""
        lines: list[str] = []
        if not self._begun:
            self._begun = True
            lines += self._open()
        for answer in answers:
            if not self.is_over:
                lines += self._answer(answer.strip())
        press = self._detector.step(now_ns, pressures)
        is_asking = not (self.is_over or self.is_complete)
        if press is not None and is_asking:
            fault = (
                f"Node {self.boards[press.board].node_id} {press.flaw}." if press.flaw else self._wrong(press)
            )
            lines += [fault, *self._ask()] if fault else self._take(press)
        if lines or self._detector.is_pressed or self._asked_ns is None:
            self._asked_ns = now_ns
        elif now_ns - self._asked_ns > REMIND_NS and is_asking:
            self._asked_ns = now_ns + 1_000_000_000 * REMIND_NS  # once
            lines.append("No press was felt. Press harder, or type skip if the board there is dead.")
            lines += self._ask()
        return lines

    def _answer(self, word: str) -> Iterator[str]:
        """Do what was typed."""
        if word in ("quit", "q", "done"):
            self.is_over, self.is_quit = True, word != "done"
        elif word in ("undo", "u"):
            yield from self._undo()
        elif word in ("skip", "s"):
            yield from self._skip()
        elif word in ("list", "l"):
            yield from self.summary()
            yield from self._ask()
        elif word:
            yield f"{printable(word, limit=40)!r} is no answer here. {HELP}."

    @abstractmethod
    def summary(self) -> Iterator[str]:
        """Return what there is."""

    @abstractmethod
    def _open(self) -> Iterator[str]:
        """Begin."""

    @abstractmethod
    def _ask(self) -> Iterator[str]:
        """Return what is asked for."""

    @abstractmethod
    def _undo(self) -> Iterator[str]:
        """Take back the last press."""

    @abstractmethod
    def _skip(self) -> Iterator[str]:
        """Leave out the place that is asked for."""

    @abstractmethod
    def _wrong(self, press: HandPress) -> str:
        """Return what is wrong with a press; nothing if it is what was asked for."""

    @abstractmethod
    def _take(self, press: HandPress) -> Iterator[str]:
        """Take a press that is what was asked for."""
