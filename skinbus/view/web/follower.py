"""Where the page has its cycles from: a source that is followed, and what it had in the last seconds."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np

from skinbus.arrays import Floats
from skinbus.skin.cycle import Cycle
from skinbus.skin.skin import Skin

PATIENCE_S = 2.0
"""How long the end of the thread is waited for."""
STEP_NS = 100_000_000
N_BINS = 200
"""Of the plot of forces."""


class History:
    """Forces by id in the last twenty seconds, the largest of each tenth of a second."""

    def __init__(self) -> None:
        self._bins: dict[int, dict[int, float]] = {}

    def take(self, cycle: Cycle) -> None:
        """Add a cycle; one of an earlier time begins anew."""
        bins, now, records = self._bins, cycle.t_ns // STEP_NS, cycle.records
        if any(k > now for k in bins):
            bins.clear()
        before = bins.get(now, {})
        forces = zip(records["id"].tolist(), records["force"].tolist(), strict=True)
        bins[now] = before | {key: max(force, before.get(key, 0.0)) for key, force in forces}
        while now - next(iter(bins)) >= N_BINS:
            del bins[next(iter(bins))]

    def forces(self, most: int) -> tuple[Floats, list[int], Floats]:
        """Return times (n,) s before now, the ids that were seen last, and their largest forces (n, k) N.

        A force is 0 where an id was not there.
        """
        bins = self._bins.copy()
        ids = dict.fromkeys(key for forces in reversed(bins.values()) for key in forces)
        shown = sorted([*ids][:most])
        newest = max(bins, default=0)
        rows = [bins.get(k, {}) for k in range(newest + 1 - N_BINS, newest + 1)]
        table = np.array([[row.get(key, 0.0) for key in shown] for row in rows])
        return np.linspace(-1e-9 * STEP_NS * (N_BINS - 1), 0.0, N_BINS), shown, table


class Follower:
    """The newest cycle of a source, by a thread of its own: drawing and source do not wait for each other."""

    def __init__(
        self,
        opening: Callable[[], Skin],
        *,
        again_s: float | None = None,
        gone: str = "no cycles: bus or master is gone",
        has_zeros: bool = True,
    ) -> None:
        """Open the source and begin to follow; ``close`` ends it.

        Args:
            opening: opens the source.
            again_s: when it has ended it is opened again after so long, s; None: then it is over.
            gone: what to say when no cycles come.
            has_zeros: whether zeros can be taken; a recording has its own.
        """
        self.history = History()
        self.newest: Cycle | None = None
        """The newest cycle; None before the first."""
        self.n_cycles = 0
        """Cycles that came."""
        self.n_opened = 1
        self.gone, self.has_zeros = gone, has_zeros
        self.error: Exception | None = None
        """What has ended the source, if that was an error; None again when it is back."""
        self._opening = opening
        self._again_s = again_s
        self._skin = opening()
        self._came_s = time.monotonic()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="skinbus-view", daemon=True)
        self._thread.start()

    @property
    def silent_s(self) -> float:
        """Time since the newest cycle came, s of the source: a slow simulation is not a silent one."""
        return (time.monotonic() - self._came_s) * min(self.pace, 1.0)

    @property
    def pace(self) -> float:
        """Seconds of the source in one of real time."""
        return self._skin.pace

    @property
    def n_lost(self) -> int:
        """Cycles that the source made, since it was opened, and that have not come here."""
        return self._skin.n_lost

    @property
    def has_ended(self) -> bool:
        """Whether no more cycles will come."""
        return not self._thread.is_alive()

    def zero(self, patch: int | None) -> None:
        """Have the source take new zeros; as :meth:`Skin.zero`."""
        self._skin.zero(patch)

    def close(self) -> None:
        """End the source and the thread."""
        self._stop.set()
        self._skin.close()
        self._thread.join(PATIENCE_S)

    def _run(self) -> None:
        """Follow one source after the other."""
        while not self._stop.is_set():
            try:
                if self.n_opened > 1:
                    self._skin = self._opening()
                self.error = None
                for cycle in self._skin:
                    self.n_cycles += 1
                    self.history.take(cycle)
                    self.newest, self._came_s = cycle, time.monotonic()
            except Exception as error:  # noqa: BLE001 - shown on the page
                self.error = error
            if self._again_s is None or self._stop.wait(self._again_s):
                return
            self._skin.close()
            self.n_opened += 1
