"""What panels show of the past: forces by id over 20 s and latencies of cycles, in rings of fixed size."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.skin.cycle import Cycle

Floats = npt.NDArray[np.float64]

SPAN_S: Final = 20.0
STEP_S: Final = 0.1
N_STEPS: Final = round(SPAN_S / STEP_S)
N_IDS: Final = 256
"""Ids of contacts are 1 to 255."""
N_LATENCIES: Final = 2048
"""Cycles of which the latency histogram is made, 40 s at 50 Hz."""


class History:
    """Takes cycles in their order."""

    def __init__(self) -> None:
        self._forces = np.full((N_STEPS, N_IDS), np.nan, np.float32)
        self._step: int | None = None
        self._latencies = np.full(N_LATENCIES, np.nan)
        self._n_latencies = 0
        self._last_number = 0
        self.n_lost = 0
        """Cycles that the source made and that have not come here."""

    def take(self, cycle: Cycle) -> None:
        """Add a cycle; one of an earlier time begins anew."""
        if cycle.number > self._last_number:  # else the source is another one
            self.n_lost += cycle.number - self._last_number - 1 if self._last_number else 0
        self._last_number = cycle.number
        step = int(cycle.t_ns / (1e9 * STEP_S))
        if self._step is None or step < self._step:
            self._forces[:] = np.nan
        else:
            gone = min(step - self._step, N_STEPS)
            self._forces[(self._step + 1 + np.arange(gone)) % N_STEPS] = np.nan
        self._step = step
        row = self._forces[step % N_STEPS]
        records = cycle.records
        if len(records):
            ids = records["id"] % N_IDS
            row[ids] = np.fmax(row[ids], records["force"].astype(np.float32))
        self._latencies[self._n_latencies % N_LATENCIES] = cycle.latency_s
        self._n_latencies += 1

    def forces(self, most: int) -> tuple[Floats, list[int], Floats]:
        """Return times (n,) s before now, the ids that were seen last, and their largest forces (n, k) N.

        A force is 0 where an id was not there.
        """
        times: Floats = (np.arange(N_STEPS, dtype=np.float64) - (N_STEPS - 1)) * STEP_S
        if self._step is None:
            return times, [], np.zeros((N_STEPS, 0))
        ordered: Floats = np.roll(self._forces, -(self._step % N_STEPS) - 1, axis=0).astype(np.float64)
        there = np.isfinite(ordered)
        last = np.where(there.any(0), N_STEPS - there[::-1].argmax(0), 0)
        ids = sorted(np.argsort(-last, kind="stable")[: min(most, int((last > 0).sum()))].tolist())
        return times, ids, np.nan_to_num(ordered[:, ids])

    def latencies(self) -> Floats:
        """Return the latencies of the last cycles, (n,) s."""
        latencies = self._latencies[: min(self._n_latencies, N_LATENCIES)]
        return np.asarray(latencies[np.isfinite(latencies)])
