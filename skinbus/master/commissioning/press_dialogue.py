"""What dialogues with a person who presses boards have in common: lines typed, presses felt, a reminder.

They have no input or output of their own: ``step`` takes pressures and what was typed meanwhile.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats
from skinbus.can.core import NEVER
from skinbus.estimate.calibration.table import mean_and_noise
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


class HandPress(NamedTuple):
    """One press, when it has ended."""

    board: int
    """The one that is pressed most."""
    others: list[int]
    """Those that are pressed nearly as much."""
    places: npt.NDArray[Any]
    """(n_boards,) u + iv of the centre of pressure, m."""
    readings: Floats
    """(n_tactels,) Pa of all boards while it was held; NaN where nothing was read."""
    noise: Floats
    """(n_tactels,) Pa, what the readings scattered by meanwhile; NaN for less than two."""
    flaw: Flaw


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

    @property
    def is_pressed(self) -> bool:
        """Whether a press is under way."""
        return bool(self._rows)

    def step(self, now_ns: int, pressures: Floats) -> HandPress | None:
        """Take the pressures (n_tactels,) Pa of a cycle; return the press that has ended with it.

        Zeros are not subtracted yet; what was not read is NaN.
        """
        self._zero = np.where(np.isnan(self._zero), pressures, self._zero)
        above = pressures - self._zero
        p = np.nan_to_num(above, nan=0.0)
        is_lit = np.maximum.reduceat(p / self._threshold, self._starts) > LIT
        is_free = ~np.repeat(is_lit, self._sizes)
        self._zero += is_free * np.where(p < -FALL * self._threshold, FALL, FOLLOW) * p
        if is_lit.any():
            self._first_ns = self._first_ns if self._rows else now_ns
            self._last_ns = now_ns
            self._rows.append((float(np.maximum(p, 0.0)[~is_free].sum()), above))
        is_stuck = now_ns - self._first_ns >= STUCK_NS and is_lit.any()
        is_over = is_stuck or now_ns - self._last_ns >= RELEASED_NS
        if not (self._rows and is_over):
            return None
        if is_stuck:
            self._zero += ~is_free * p
        is_short = self._last_ns - self._first_ns < HOLD_NS
        press = self._press(Flaw.STUCK if is_stuck else Flaw.SHORT if is_short else Flaw.NONE)
        self._rows = []
        return press

    def _press(self, flaw: Flaw) -> HandPress | None:
        """Return the press under way; None if it was short and light: noise, or a sleeve."""
        strengths = np.array([strength for strength, _ in self._rows])
        usual = np.quantile(strengths[strengths >= STRONG * strengths.max()], 0.5, method="lower")
        held = np.abs(strengths / usual - 1.0) < STEADY
        readings, noise = mean_and_noise(np.array([above for _, above in self._rows])[held])
        mean = np.nan_to_num(readings, nan=0.0)
        share = np.where(mean > 0.5 * self._threshold, mean, 0.0)  # what is less is noise, and pulls inwards
        strength = np.add.reduceat(share, self._starts)
        board = int(strength.argmax())
        weight = np.maximum(mean, 0.0)
        moment = np.add.reduceat(weight * self._at, self._starts)
        whole = np.add.reduceat(weight, self._starts)
        if np.maximum.reduceat(mean / self._threshold, self._starts)[board] < LIGHT:
            if flaw is Flaw.SHORT:
                return None
            flaw = flaw or Flaw.LIGHT
        others = [b for b in np.flatnonzero(strength > SECOND * strength[board]).tolist() if b != board]
        places = moment / np.maximum(whole, 1e-300)
        return HandPress(board, others, places, readings, noise, flaw)


REMIND_NS = 20_000_000_000
"""Without a press for so long possible causes are shown, once."""


HELP = (
    "Press for a second where the next line says, let go, and wait for the next line. undo: take back the "
    "last press; skip: leave this place out; done: that is enough; quit: stop."
)


class PressDialogue(ABC):
    """A dialogue about presses on ``boards``, whose pressures it gets, in their order.

    Whatever is said, the question follows. It is over when no place is left to press, or as ``done`` and
    ``quit`` say.
    """

    def __init__(self, boards: Sequence[Board]) -> None:
        self.boards = tuple(boards)
        self.is_over = self.is_quit = False
        self._detector = PressDetector(boards)
        self._remind_ns = 0

    def step(self, now_ns: int, pressures: Floats, answers: Sequence[str] = ()) -> list[str]:
        """Take the pressures (n_tactels,) Pa of a cycle and lines that were typed; return lines to show."""
        lines: list[str] = [] if self._remind_ns else [HELP, self.ask()]
        for answer in answers:
            if not self.is_over:
                lines += self._answer(answer.strip())
        press = self._detector.step(now_ns, pressures)
        if press is not None and not self.is_over:
            flaw = f"Node {self.boards[press.board].node_id} {press.flaw}."
            lines += [flaw if press.flaw else self.take(press), self.ask()]
        if lines or self._detector.is_pressed:
            self._remind_ns = now_ns + REMIND_NS
        elif now_ns > self._remind_ns and not self.is_over:
            self._remind_ns = NEVER
            lines += ["No press was felt. Press harder, or type skip if the board there is dead.", self.ask()]
        return [line for line in lines if line]

    def _answer(self, word: str) -> list[str]:
        """Do what was typed."""
        if word in ("quit", "done"):
            self.is_over, self.is_quit = True, word == "quit"
            return []
        said = f"{printable(word, limit=40)!r} is no answer here. {HELP}" if word else ""
        return [self.undo() if word == "undo" else self.skip() if word == "skip" else said, self.ask()]

    @abstractmethod
    def ask(self) -> str:
        """Return what is asked for; where nothing is left it is over."""

    @abstractmethod
    def take(self, press: HandPress) -> str:
        """Take a press that has no flaw; return what is said of it, first of all what is wrong with it."""

    @abstractmethod
    def undo(self) -> str:
        """Take back the last press."""

    @abstractmethod
    def skip(self) -> str:
        """Leave out the place that is asked for."""
