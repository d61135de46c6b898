"""Health of each tactel over months: noise, zero, touches and faults since the board was commissioned.

A board is commissioned when it is first seen with its serial number and calibration; another board, or new
gains, begin anew. References are taken after enough samples. Compared with them are

noise   running standard deviation while nothing touches (Pa)
zero    subtracted from the readings (Pa)
slope   of the zero on the median zero of its board: temperature moves the zeros of a board together, so a
        tactel with another slope than 1 has a temperature coefficient of its own

Each patch has one record of columns, updated once a cycle or more rarely. Nothing here changes what the
master does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import TactelFault
from skinbus.master.cycle import Cycle
from skinbus.master.cycle_report import CycleReport
from skinbus.master.memory import fingerprint, names_of, numbers_in
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Records = npt.NDArray[np.void]
"""Health of tactels, (n_tactels,) of ``DTYPE``."""

NAMES: Final = (
    *("noise", "noise_first", "zero", "zero_first"),  # NaN until they are known
    *("samples", "zero_mean"),
    *("board_mean", "board_square"),  # mean of the median zero of its board, and squares about it, Pa^2
    "product",  # of both zeros about their means, Pa^2
    *("touches", "faults"),  # how often it was touched, and became implausible
    "seen",  # bits of ``TactelFault`` that it ever had
)
"""Columns of a tactel."""
UNKNOWN: Final = NAMES[:4]
COUNTS: Final = ("samples", "touches", "faults", "seen", "board_square")
DTYPE: Final = np.dtype([(name, np.float64) for name in NAMES])

SAMPLE_NS: Final = 10_000_000_000
"""Between two samples of zeros and noise: temperature takes minutes."""
SETTLED: Final = 30
"""Samples of zero and noise, five minutes, after which they are references."""
DIGITS: Final = 6

NOISY: Final = 3.0
"""Times its first noise, and the noise of its file: three times noisier is a fault of the tactel."""
SCALED: Final = 1.6
"""Factor common to the noise of a board from which its readings may be scaled: references err by a tenth."""
SIGMAS: Final = 4.0
SLOPE: Final = 0.5
"""Difference of a slope from 1: such a tactel leaves half of every change of temperature in its readings."""
FAULTY_SHARE: Final = 0.15
"""Part of a board's tactels with findings from which the board is to be replaced: 3 of 16."""
OFTEN: Final = 10
"""Times that a tactel became implausible from which that is a finding by itself."""


def new_records(n: int) -> Records:
    """Return the records of n tactels of which nothing was seen."""
    records = np.zeros(n, DTYPE)
    for name in UNKNOWN:
        records[name] = np.nan
    return records


class Health:
    """Watches the stages of a master from cycle to cycle; ``records`` (n_tactels,) hold what was seen."""

    def __init__(self, cycle: Cycle) -> None:
        self._arm = arm = cycle.arm
        self._cycle = cycle
        self.records = new_records(arm.n_tactels)
        self._touched = np.zeros(arm.n_tactels, np.bool_)
        self._faulty = np.zeros(arm.n_tactels, np.bool_)
        self._next_ns = 0

    def observe(self, report: CycleReport) -> None:
        """Take a cycle."""
        w = self.records
        touched = self._cycle.baseline.felt.touched != 0
        w["touches"] += touched & ~self._touched
        self._touched = touched
        faults = self._cycle.plausibility.faults
        faulty = faults != 0
        begun = faulty & ~self._faulty
        if begun.any():
            w["faults"] += begun
            w["seen"][begun] = w["seen"][begun].astype(np.int64) | faults[begun]
        self._faulty = faulty
        if report.t_ns >= self._next_ns:
            self._next_ns = report.t_ns + SAMPLE_NS
            self._sample(report)

    def _sample(self, report: CycleReport) -> None:
        """Sample zeros and noise of free tactels."""
        arm, w = self._arm, self.records
        kept = self._cycle.baseline.kept()
        use = kept.zeroed & ~kept.touched & ~self._faulty & report.fresh[arm.tactel_patch]
        w["zero"][use] = kept.zero[use]
        w["noise"][use] = np.sqrt(kept.variance[use])
        w["samples"] += use
        for p in np.unique(arm.tactel_patch[use]).tolist():
            here = arm.tactels_of(p)
            own, zero = w[here][use[here]], kept.zero[here][use[here]]
            off, off_board = zero - own["zero_mean"], np.median(zero) - own["board_mean"]
            own["zero_mean"] += off / own["samples"]
            own["board_mean"] += off_board / own["samples"]
            own["product"] += off_board * (zero - own["zero_mean"])
            own["board_square"] += off_board * (np.median(zero) - own["board_mean"])
            w[here][use[here]] = own
        first = use & (w["samples"] >= SETTLED) & np.isnan(w["zero_first"])
        w["zero_first"][first], w["noise_first"][first] = w["zero"][first], w["noise"][first]

    def as_tables(self, records: Records) -> dict[str, Any]:
        """Return a copy of the records as tables of numbers; null for what is not known."""
        arm, patches = self._arm, {}
        for p, name in enumerate(names_of(arm)):
            own = records[arm.tactels_of(p)]
            columns = {key: [_number(v) for v in own[key].tolist()] for key in NAMES}
            patches[name] = {"board": fingerprint(arm, p), **columns}
        return {"arm": arm.name, "health": patches}

    def resume(self, tables: dict[str, Any]) -> int:
        """Take up what an earlier run has seen; return of how many boards. Nothing in the tables raises."""
        found = read_health(self._arm, tables)
        for p, own in enumerate(found):
            if own is not None:
                self.records[self._arm.tactels_of(p)] = own
        return sum(own is not None for own in found)


def read_health(arm: Arm, tables: dict[str, Any]) -> list[Records | None]:
    """Return what tables say of each patch, None of one with another serial number or calibration.

    None, too, where there is nothing that is whole.
    """
    patches = tables.get("health")
    found: list[Records | None] = []
    for p, name in enumerate(names_of(arm)):
        own = patches.get(name) if isinstance(patches, dict) else None
        if isinstance(own, dict) and own.get("board") == fingerprint(arm, p):
            found.append(_records(own, arm.patches[p].patch.n_tactels))
        else:
            found.append(None)
    return found


def _records(own: dict[str, Any], n: int) -> Records | None:
    records = new_records(n)
    for name in NAMES:
        column = numbers_in(own.get(name), n, may_miss=True)
        if column is None or (name in COUNTS and not (column >= 0.0).all()):
            return None
        records[name] = column
    return records


def _number(value: float) -> float | None:
    return float(f"{value:.{DIGITS}g}") if value == value else None


# what it says


@dataclass(frozen=True, slots=True)
class HealthFinding:
    """One thing to say of a board."""

    patch: int
    tactels: tuple[int, ...]
    """From 1; none for the whole board."""
    what: str
    advice: str


def findings(arm: Arm, boards: Sequence[Records | None]) -> list[HealthFinding]:
    """Return what is to be said of the boards of an arm: what changed, and what to do."""
    found: list[HealthFinding] = []
    for p, own in enumerate(boards):
        if own is not None:
            found += _of_board(arm, p, own)
    return found


def slopes(own: Records) -> Floats:
    """Return the slope of each zero on that of its board, (n_tactels,); NaN where the board has not moved."""
    noise = np.nan_to_num(own["noise"], nan=np.inf)
    # the mean of a board has to have moved by a few times what a single zero errs
    moved = np.sqrt(own["board_square"] / np.maximum(own["samples"], 1.0)) > 0.5 * noise
    return np.where(moved, own["product"] / np.where(moved, own["board_square"], 1.0), np.nan)


def _of_board(arm: Arm, p: int, own: Records) -> Iterator[HealthFinding]:
    here = arm.tactels_of(p)
    healthy = arm.tactel_healthy[here]
    noise, noise_first = own["noise"], own["noise_first"]
    dead = (own["seen"].astype(np.int64) & int(TactelFault.DEAD | TactelFault.FROZEN)) != 0
    rows = (  # comparisons with NaN, which is not known yet, are false
        (dead, "dead or frozen at times", 'clear their bits in "Healthy tactels"'),
        (
            (own["faults"] >= OFTEN) & ~dead,
            f"implausible {OFTEN} times or more",
            "look at connector and cable of the board",
        ),
        (
            (noise > NOISY * noise_first) & (noise > NOISY * arm.tactel_noise[here]),
            f"noise {NOISY:g} times that at commissioning",
            "look at cable and shield; else take them out",
        ),
        (
            np.abs(own["zero"] - own["zero_first"]) > arm.tactel_zero_band[here],
            "zeros moved by more than their band",
            "look for what presses; else calibrate the board again",
        ),
        (
            np.abs(slopes(own) - 1.0) > SLOPE,
            "zeros do not move with those of their board",
            "calibrate at working temperature",
        ),
    )
    worst = np.zeros(len(healthy), np.bool_)
    for is_so, what, advice in rows:
        is_so = is_so & healthy
        worst |= is_so
        if is_so.any():
            yield HealthFinding(p, tuple((1 + np.flatnonzero(is_so)).tolist()), what, advice)
    with np.errstate(invalid="ignore", divide="ignore"):
        grown = np.log(noise / noise_first)
    grown = grown[healthy & np.isfinite(grown) & ~worst]
    factor, error = (grown.mean(), grown.std() / np.sqrt(len(grown))) if len(grown) else (0.0, 0.0)
    if abs(factor) > max(np.log(SCALED), SIGMAS * error):
        what = f"noise of the whole board {np.exp(factor):.1f} times that at commissioning"
        yield HealthFinding(p, (), what, "press it with a known force: its readings may be scaled")
    if worst.sum() > FAULTY_SHARE * len(healthy):
        n = int(worst.sum())
        yield HealthFinding(p, (), f"{n} of {len(healthy)} tactels have findings", "replace the board")
