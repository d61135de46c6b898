"""Health of each tactel over months: noise, zero and faults since the board was commissioned.

A board is commissioned when it is first seen with its serial number and calibration; another board, or new
gains, begin anew. References are taken after enough samples. Compared with them are
the noise, a running standard deviation while nothing touches, and the zero that is subtracted (both Pa).

Each patch has one record of columns, updated once a cycle or more rarely. Nothing here changes what the
master does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.estimate import TactelFault
from skinbus.master.cycle import Cycle, CycleReport
from skinbus.master.memory import fingerprint, names_of, tables_of
from skinbus.model import Arm

Records = npt.NDArray[np.void]
"""Health of tactels, (n_tactels,) of ``DTYPE``."""

NAMES = (
    *("noise", "noise_first", "zero", "zero_first"),  # NaN until they are known
    *("samples", "faults"),  # how often it was sampled, and became implausible
    "seen",  # bits of ``TactelFault`` that it ever had
    "serial",  # number of its board, 0 for not known
)
"""Columns of a tactel."""
DTYPE = np.dtype([(name, np.float64) for name in NAMES])

SAMPLE_NS = 10_000_000_000
"""Between two samples of zeros and noise: temperature takes minutes."""
SETTLED = 30
"""Samples of zero and noise, five minutes, after which they are references."""

NOISY = 3.0
"""Times its first noise, and the noise of its file: three times noisier is a fault of the tactel."""
FAULTY_SHARE = 0.15
"""Part of a board's tactels with findings from which the board is to be replaced: 3 of 16."""
OFTEN = 10
"""Times that a tactel became implausible from which that is a finding by itself."""


def new_records(n: int) -> Records:
    """Return the records of n tactels of which nothing was seen."""
    records = np.zeros(n, DTYPE)
    for name in NAMES[:4]:
        records[name] = np.nan
    return records


class Health:
    """Watches the stages of a master from cycle to cycle; ``records`` (n_tactels,) hold what was seen."""

    def __init__(self, cycle: Cycle) -> None:
        self._arm = arm = cycle.arm
        self._cycle = cycle
        self.records = new_records(arm.n_tactels)
        self._faulty = np.zeros(arm.n_tactels, np.bool_)
        self._next_ns = 0
        self._serials = np.zeros(arm.n_patches, np.int64)

    def observe(self, report: CycleReport) -> None:
        """Take a cycle."""
        w = self.records
        if (self._cycle.serials != self._serials).any():
            self._serials = self._cycle.serials.copy()
            serial = self._serials[self._arm.tactel_patch]
            is_new = (serial != 0) & (serial != w["serial"])
            w[is_new & (w["serial"] != 0)] = new_records(1)
            w["serial"][is_new] = serial[is_new]
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
        w = self.records
        kept = self._cycle.baseline.kept()
        use = kept.zeroed & ~kept.touched & ~self._faulty & report.fresh[self._arm.tactel_patch]
        w["zero"][use] = kept.zero[use]
        w["noise"][use] = np.sqrt(kept.variance[use])
        w["samples"] += use
        first = use & (w["samples"] >= SETTLED) & np.isnan(w["zero_first"])
        w["zero_first"][first], w["noise_first"][first] = w["zero"][first], w["noise"][first]

    def snapshot(self) -> Records:
        """Return a copy of the records."""
        return self.records.copy()

    def as_tables(self, records: Records) -> dict[str, Any]:
        """Return a copy of the records as tables of numbers; null for what is not known."""
        return {"health": tables_of(self._arm, {key: records[key] for key in NAMES})}

    def resume(self, tables: dict[str, Any]) -> int:
        """Take up what an earlier run has seen; return of how many boards."""
        found = read_health(self._arm, tables)
        for p, own in enumerate(found):
            if own is not None:
                self.records[self._arm.tactels_of(p)] = own
        return sum(own is not None for own in found)


def read_health(arm: Arm, tables: dict[str, Any]) -> list[Records | None]:
    """Return what tables say of each patch, None of one with another serial number or calibration."""
    return [_records(arm, p, tables["health"].get(name, {})) for p, name in enumerate(names_of(arm))]


def _records(arm: Arm, p: int, own: dict[str, Any]) -> Records | None:
    if own.get("board") != fingerprint(arm, p):
        return None
    records = new_records(arm.patches[p].patch.n_tactels)
    for name in NAMES:
        records[name] = np.array(own[name], np.float64)
    return records


# what it says


class HealthFinding(NamedTuple):
    """One thing to say of a board."""

    patch: int
    tactels: tuple[int, ...]
    """From 1; none for the whole board."""
    what: str
    advice: str


def findings(arm: Arm, boards: Sequence[Records | None]) -> Iterator[HealthFinding]:
    """Yield what is to be said of the boards of an arm: what changed, and what to do."""
    for p, own in enumerate(boards):
        if own is None:
            continue
        here = arm.tactels_of(p)
        healthy = arm.tactel_healthy[here]
        noise = own["noise"]
        noise_first = own["noise_first"]
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
        )
        worst = np.zeros(len(healthy), np.bool_)
        for is_so, what, advice in rows:
            which = np.flatnonzero(is_so & healthy)
            worst[which] = True
            if len(which):
                yield HealthFinding(p, tuple((1 + which).tolist()), what, advice)
        if (n := int(worst.sum())) > FAULTY_SHARE * len(healthy):
            yield HealthFinding(p, (), f"{n} of {len(healthy)} tactels have findings", "replace the board")
