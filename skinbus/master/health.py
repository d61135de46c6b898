"""Health of each tactel over months: noise, zero, gain, touches and faults since the board was commissioned.

Commissioned is a board when it is first seen with its serial number and calibration: another board, or new
gains, begin anew. References are taken when enough was seen; what is compared with them is

noise   standard deviation while nothing touches (Pa), a running one
zero    what is subtracted (Pa)
slope   of the zero on the median zero of its board: temperature moves the zeros of a board together, so a
        tactel that follows by another factor than 1 has a temperature coefficient of its own
gain    relative to the other tactels of the board, see ``gain_watch``

All is counted in arrays once a cycle or more rarely. Nothing here changes what the master does, but for gains
that are learned from everyday touches where that is asked for (``everyday_gains``).
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, fields
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.master.cycle import Cycle
from skinbus.master.cycle_report import CycleReport
from skinbus.master.everyday_gains import LearnedGains
from skinbus.master.gain_watch import CONTACT_NS, GainWatch, learn_gains
from skinbus.master.memory import fingerprint, names_of
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]

SAMPLE_NS: Final = 10_000_000_000
"""Between two samples of zeros and noise: temperature takes minutes."""
SETTLED: Final = 30
"""Samples of zero and noise, five minutes, after which they are references."""
DIGITS: Final = 6


@dataclass(slots=True)
class HealthColumns:
    """Per tactel (n_tactels,); NaN where there is none yet."""

    noise: Floats
    noise_first: Floats
    zero: Floats
    zero_first: Floats
    samples: Floats
    zero_mean: Floats
    board_mean: Floats
    """Mean of the median zero of its board, over the same samples."""
    board_square: Floats
    """Sum of squares of that about its mean, Pa^2."""
    product: Floats
    """Sum of products of both about their means, Pa^2."""
    touches: Floats
    faults: Floats
    """How often it became implausible."""
    seen: Floats
    """Bits of ``Fault`` that it ever had."""

    @classmethod
    def new(cls, n: int) -> HealthColumns:
        """Return those of n tactels of which nothing was seen."""
        unknown = ("noise", "noise_first", "zero", "zero_first")
        return cls(**{f.name: np.full(n, np.nan if f.name in unknown else 0.0) for f in fields(cls)})


NAMES: Final = tuple(f.name for f in fields(HealthColumns))


class BoardHealth(NamedTuple):
    """What is known of one board."""

    columns: HealthColumns
    gains: GainWatch
    learned: dict[str, Any]
    """What everyday touches have come to, as ``LearnedGains.as_table``; empty where they teach nothing."""


class Snapshot(NamedTuple):
    """What is kept of an arm."""

    columns: HealthColumns
    gains: list[GainWatch]
    learned: list[LearnedGains]


class Health:
    """Watches the stages of a master from cycle to cycle."""

    def __init__(self, cycle: Cycle) -> None:
        self._arm = arm = cycle.arm
        self._cycle = cycle
        self._names = names_of(arm)
        self._prints = [fingerprint(arm, p) for p in range(arm.n_patches)]
        self.columns = HealthColumns.new(arm.n_tactels)
        self.gains = [GainWatch(len(placed.patch.tactels_uv)) for placed in arm.patches]
        """By patch."""
        self._touched = np.zeros(arm.n_tactels, np.bool_)
        self._faulty = np.zeros(arm.n_tactels, np.bool_)
        self._next_ns = 0
        self._next_gain_ns = 0

    def observe(self, report: CycleReport) -> None:
        """Take a cycle."""
        w = self.columns
        touched = self._cycle.baseline.felt.touched != 0
        w.touches += touched & ~self._touched
        self._touched = touched
        faults = self._cycle.plausibility.faults
        faulty = faults != 0
        begun = faulty & ~self._faulty
        if begun.any():
            w.faults += begun
            w.seen[begun] = w.seen[begun].astype(np.int64) | faults[begun]
        self._faulty = faulty
        if report.t_ns >= self._next_ns:
            self._next_ns = report.t_ns + SAMPLE_NS
            self._sample(report)
        if len(report.contacts) and report.t_ns >= self._next_gain_ns:
            self._next_gain_ns = report.t_ns + CONTACT_NS
            plausible = np.where(faulty, np.nan, report.pressures)
            learn_gains(self._arm, self.gains, report.contacts, plausible)
            if self._cycle.everyday is not None:
                self._cycle.everyday.observe(report.contacts, plausible)

    def _sample(self, report: CycleReport) -> None:
        """Sample zeros and noise of free tactels."""
        arm, w = self._arm, self.columns
        kept = self._cycle.baseline.kept()
        use = kept.zeroed & ~kept.touched & ~self._faulty & report.fresh[arm.tactel_patch]
        if not use.any():
            return
        w.zero[use] = kept.zero[use]
        w.noise[use] = np.sqrt(kept.variance[use])
        board = _medians(arm.tactel_patch[use], kept.zero[use], arm.n_patches)[arm.tactel_patch]
        n = w.samples = w.samples + use
        share = np.where(use, 1.0 / np.maximum(n, 1.0), 0.0)
        off, off_board = kept.zero - w.zero_mean, board - w.board_mean
        w.zero_mean += share * off
        w.board_mean += share * off_board
        w.product += np.where(use, off_board * (kept.zero - w.zero_mean), 0.0)
        w.board_square += np.where(use, off_board * (board - w.board_mean), 0.0)
        first = use & (n >= SETTLED) & np.isnan(w.zero_first)
        w.zero_first[first], w.noise_first[first] = w.zero[first], w.noise[first]

    def snapshot(self, date: str = "") -> Snapshot:
        """Return copies of all that is to be kept; ``date`` is the day on which that is."""
        everyday = self._cycle.everyday
        if everyday is not None:
            everyday.stamp(date)
        learned = [] if everyday is None else everyday.boards
        return Snapshot(deepcopy(self.columns), deepcopy(self.gains), deepcopy(learned))

    def as_tables(self, snapshot: Snapshot) -> dict[str, Any]:
        """Return a snapshot as tables of numbers; null for what there is not."""
        arm, patches = self._arm, {}
        for p, name in enumerate(self._names):
            here = arm.tactels_of(p)
            columns = {key: _numbers(getattr(snapshot.columns, key)[here]) for key in NAMES}
            patches[name] = {"board": self._prints[p], **columns, "gains": snapshot.gains[p].as_table()}
            if snapshot.learned:
                patches[name]["learned"] = snapshot.learned[p].as_table()
        return {"arm": arm.name, "health": patches}

    def resume(self, tables: dict[str, Any]) -> int:
        """Take up what an earlier run has seen; return of how many boards. Nothing in the tables raises."""
        n = 0
        for p, own in enumerate(read_health(self._arm, tables)):
            if own is None:
                continue
            n += 1
            for key in NAMES:
                getattr(self.columns, key)[self._arm.tactels_of(p)] = getattr(own.columns, key)
            self.gains[p] = own.gains
            if self._cycle.everyday is not None:
                self._cycle.everyday.resume(p, own.learned)
        return n


def read_health(arm: Arm, tables: dict[str, Any]) -> list[BoardHealth | None]:
    """Return what tables say of each patch, None of one with another serial number or calibration.

    None, too, where there is nothing that is whole.
    """
    patches = tables.get("health")
    found: list[BoardHealth | None] = []
    for p, name in enumerate(names_of(arm)):
        own = patches.get(name) if isinstance(patches, dict) else None
        if not isinstance(own, dict) or own.get("board") != fingerprint(arm, p):
            found.append(None)
            continue
        n = len(arm.patches[p].patch.tactels_uv)
        columns, gains = _columns(own, n), GainWatch.of_table(own.get("gains"), n)
        learned = own.get("learned")
        found.append(
            None
            if columns is None or gains is None
            else BoardHealth(columns, gains, learned if isinstance(learned, dict) else {})
        )
    return found


def _medians(group: npt.NDArray[np.int32], values: Floats, n: int) -> Floats:
    """Return the (upper) median of the values of each group, (n,); 0 of none."""
    order = np.lexsort((values, group))
    first = np.searchsorted(group[order], np.arange(n + 1))
    medians = np.zeros(n)
    some = first[:-1] < first[1:]
    medians[some] = values[order][((first[:-1] + first[1:]) // 2)[some]]
    return medians


def _columns(own: dict[str, Any], n: int) -> HealthColumns | None:
    columns: dict[str, Floats] = {}
    for name in NAMES:
        values = own.get(name)
        if not isinstance(values, list) or len(values) != n:
            return None
        if not all(v is None or (isinstance(v, int | float) and abs(v) < 1e15) for v in values):
            return None
        columns[name] = np.array([np.nan if v is None else v for v in values], np.float64)
        counts = ("samples", "touches", "faults", "seen", "board_square")
        if name in counts and not (columns[name] >= 0.0).all():
            return None
    return HealthColumns(**columns)


def _numbers(column: Floats) -> list[float | None]:
    return [float(f"{v:.{DIGITS}g}") if v == v else None for v in column.tolist()]
