"""What dialogues with a person who presses boards have in common: lines typed, presses felt, a reminder.

They have no input or output of their own: ``step`` takes pressures and what was typed meanwhile.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.master.commissioning.board_presses import Board, HandPress, PressDetector

Floats = npt.NDArray[np.float64]

REMIND_NS: Final = 20_000_000_000
"""Without a press for so long possible causes are shown, once."""


class PressDialogue(ABC):
    """A dialogue about presses on ``boards``, whose pressures it gets, in their order."""

    def __init__(self, boards: Sequence[Board]) -> None:
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
            lines += self._answer(answer.strip())
        press = self._detector.step(now_ns, pressures)
        if press is not None and not (self.is_over or self.is_complete):
            lines += self._take(press)
        if lines or self._detector.is_pressed or self._asked_ns is None:
            self._asked_ns = now_ns
        elif now_ns - self._asked_ns > REMIND_NS and not (self.is_over or self.is_complete):
            self._asked_ns = now_ns + 1_000_000_000 * REMIND_NS  # once
            lines.append("No press was felt. Press harder, or type skip if the board there is dead.")
            lines += self._ask()
        return lines

    @abstractmethod
    def _open(self) -> Iterator[str]:
        """Begin."""

    @abstractmethod
    def _ask(self) -> Iterator[str]:
        """Return what is asked for."""

    @abstractmethod
    def _answer(self, word: str) -> Iterator[str]:
        """Do what was typed."""

    @abstractmethod
    def _take(self, press: HandPress) -> Iterator[str]:
        """Take a press, or name what is wrong with it."""
