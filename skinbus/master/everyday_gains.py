"""Corrections of relative gains by contacts that happen anyway: slow, bounded, and off unless asked for.

Only a contact that is alone on its board and has no flag counts; each 4 mm of a board count a few at a time,
so that the same place pressed for ever shows what the law misfits there but a few times; and nothing moves
before contacts were spread over a board. The mean of a board stays: absolute scale cannot be seen.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import Contacts
from skinbus.estimate.kernels.layout import limit_of
from skinbus.master.gain_watch import DIFFERENCES, GainWatch, alone, column_of, learn_contact, numbers_of
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]

BOUND: Final = 0.1
"""By which a gain may be corrected: boards differ by 3 to 8 %; more is a fault, which ``health`` reports."""
STEP, EVERY = 0.01, 20
"""A gain moves by so much at most, each time so many contacts of its board have counted."""
FEWEST: Final = 100
"""Contacts, counted by cells, before a board is corrected: a third of a usual one was touched by then."""
CELL_M, MOST = 4e-3, 3.0
"""Size of a cell, m, and the contacts that it counts. Misfits of a law change over some 8 mm."""


class LearnedGains:
    """What was learned of one board."""

    def __init__(self, n: int, shape: tuple[int, int]) -> None:
        self.factor = np.ones(n)
        """(n,) by which pressures are multiplied."""
        self.watch = GainWatch(n, DIFFERENCES)
        self.cells = np.zeros(shape)
        self.date = ""
        """Day on which the factors moved last, as given to ``stamp``."""
        self.has_moved = False

    @property
    def moved(self) -> float:
        """Root mean square of the corrections."""
        return float(np.sqrt(np.mean((self.factor - 1.0) ** 2)))

    def counts(self, place: Floats) -> bool:
        """Count a contact at a place (2,) m from a corner; return whether its cell has not had enough."""
        most = np.array(self.cells.shape) - 1
        cell = tuple(np.clip((place / CELL_M).astype(np.intp), 0, most))
        self.cells *= DIFFERENCES.keep
        if self.cells[cell] > MOST - 1.0:
            return False
        self.cells[cell] += 1.0
        return True

    def move(self) -> None:
        """Move the factors towards the gains, if contacts have been spread over the board."""
        if self.watch.n_contacts % EVERY or self.cells.sum() < FEWEST:
            return
        gain, _ = self.watch.gains()
        limit = BOUND - STEP  # the mean takes some of it back
        wanted = 1.0 / (1.0 + np.clip(gain - gain.mean(), -limit, limit))
        self.factor += np.clip(wanted / wanted.mean() - self.factor, -STEP, STEP)
        self.factor = np.clip(self.factor / self.factor.mean(), 1.0 - BOUND, 1.0 + BOUND)
        self.has_moved = True

    def as_table(self) -> dict[str, Any]:
        """Return it as numbers."""
        return {
            "factor": numbers_of(self.factor),
            "moved": float(f"{self.moved:.4g}"),
            "date": self.date,
            "cells": numbers_of(self.cells.ravel()),
            **self.watch.as_table(),
        }

    def resume(self, table: Any) -> None:
        """Take up a table; nothing happens if it is not whole."""
        watch = GainWatch.of_table(table, self.watch.n, DIFFERENCES)
        if watch is None:
            return
        factor = column_of(table.get("factor"), watch.n)
        cells = column_of(table.get("cells"), self.cells.size)
        if factor is None or cells is None or not (np.abs(factor - 1.0) <= BOUND + 1e-5).all():
            return
        self.watch, self.factor = watch, np.clip(factor, 1.0 - BOUND, 1.0 + BOUND)
        self.cells = np.clip(cells, 0.0, MOST).reshape(self.cells.shape)
        self.date = str(table.get("date", ""))[:10]


class EverydayGains:
    """Corrects the pressures of an arm, and learns by how much."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._limit = limit_of(arm)
        self.factor = np.ones(arm.n_tactels)
        self.boards = [
            LearnedGains(placed.patch.n_tactels, _cells(placed.patch.size)) for placed in arm.patches
        ]

    def correct(self, pressures: Floats, zero: Floats) -> None:
        """Multiply pressures (n_tactels,) Pa, less the zeros, in place; those at full scale stay there."""
        np.multiply(pressures, self.factor, out=pressures, where=pressures < self._limit - zero)

    def observe(self, contacts: Contacts, pressures: Floats) -> None:
        """Learn from the contacts made of corrected pressures (n_tactels,); NaN where implausible."""
        arm = self._arm
        for c in alone(arm, contacts):
            p = int(contacts.patch[c])
            board, size = self.boards[p], np.array(arm.patches[p].patch.size)
            (place,) = arm.on_board(p, contacts.s[c : c + 1], contacts.a[c : c + 1])
            if not board.counts(place + 0.5 * size):
                continue
            if learn_contact(arm, board.watch, contacts, c, pressures / self.factor):
                board.move()
                self.factor[arm.tactels_of(p)] = board.factor

    def resume(self, p: int, table: Any) -> None:
        """Take up what was learned of a board."""
        self.boards[p].resume(table)
        self.factor[self._arm.tactels_of(p)] = self.boards[p].factor

    def stamp(self, date: str) -> None:
        """Note the day for the boards whose factors have moved since."""
        for board in self.boards:
            if board.has_moved:
                board.date, board.has_moved = date, False


def _cells(size: tuple[float, float]) -> tuple[int, int]:
    return int(np.ceil(size[0] / CELL_M)), int(np.ceil(size[1] / CELL_M))
