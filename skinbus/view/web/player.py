"""Where the page has its cycles from: a source that is followed, or a recording that is played."""

from __future__ import annotations

import bisect
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.skin.cycle import Cycle
from skinbus.skin.skin import Skin

Floats = npt.NDArray[np.float64]

PATIENCE_S: Final = 2.0
"""How long the end of the thread is waited for."""
SPAN_NS: Final = 20_000_000_000
STEP_NS: Final = 100_000_000
"""Of the plot of forces."""
SPEEDS: Final = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0)


class History:
    """Forces by id and latencies of the cycles of the last twenty seconds."""

    def __init__(self) -> None:
        self._rows: deque[tuple[int, float, dict[int, float]]] = deque()
        self._last_number = 0
        self.n_lost = 0
        """Cycles that the source made and that have not come here."""

    def take(self, cycle: Cycle) -> None:
        """Add a cycle; one of an earlier time begins anew."""
        rows, t_ns, records = self._rows, cycle.t_ns, cycle.records
        if cycle.number > self._last_number > 0:  # else the source is another one
            self.n_lost += cycle.number - self._last_number - 1
        self._last_number = cycle.number
        if rows and rows[-1][0] > t_ns:
            rows.clear()
        forces = dict(zip(records["id"].tolist(), records["force"].tolist(), strict=True))
        rows.append((t_ns, cycle.latency_s, forces))
        while t_ns - rows[0][0] >= SPAN_NS:
            rows.popleft()

    def forces(self, most: int) -> tuple[Floats, list[int], Floats]:
        """Return times (n,) s before now, the ids that were seen last, and their largest forces (n, k) N.

        A force is 0 where an id was not there.
        """
        rows, n = self._rows.copy(), SPAN_NS // STEP_NS
        times: Floats = (np.arange(n, dtype=np.float64) - (n - 1)) * 1e-9 * STEP_NS
        ids: dict[int, None] = {}
        for _, _, forces in reversed(rows):
            ids |= dict.fromkeys(forces)
        shown = sorted(list(ids)[:most])
        table = np.zeros((n, len(shown)))
        for t_ns, _, forces in rows:
            k = n - 1 - (rows[-1][0] - t_ns) // STEP_NS
            for column, key in enumerate(shown):
                table[k, column] = max(table[k, column], forces.get(key, 0.0))
        return times, shown, table

    def latencies(self) -> Floats:
        """Return the latencies of the cycles, (n,) s."""
        return np.array([latency_s for _, latency_s, _ in self._rows.copy()])


class Follower:
    """The newest cycle of a source, by a thread of its own: drawing and source do not wait for each other."""

    def __init__(
        self,
        opening: Callable[[], Skin],
        *,
        again_s: float | None = None,
        gone: str = "no cycles: bus or master is gone",
    ) -> None:
        """Open the source and begin to follow; ``close`` ends it.

        Args:
            opening: opens the source.
            again_s: when it has ended it is opened again after so long, s; None: then it is over.
            gone: what to say when no cycles come.
        """
        self.history = History()
        self.newest: Cycle | None = None
        """The newest cycle; None before the first."""
        self.n_cycles = 0
        """Cycles that came."""
        self.n_opened = 1
        self.gone = gone
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
        """Time since the newest cycle came, s."""
        return time.monotonic() - self._came_s

    @property
    def pace(self) -> float:
        """Seconds of the source in one of real time."""
        return self._skin.pace

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


class Player:
    """A recording made once, as fast as the machine can, and played: where it stands, how fast, step by step.

    Its cycles are kept in memory; time goes on by ``advance`` only.
    """

    silent_s, pace, gone = 0.0, 1.0, ""

    def __init__(self, skin: Skin) -> None:
        self.seconds = 0.0
        """Where it stands, s after the first cycle."""
        self.speed = 1.0
        self.is_playing = True
        self.history = History()
        self.error: Exception | None = None
        """What has ended the making, if that was an error."""
        self._skin = skin
        self._cycles: list[Cycle] = []
        self._times: list[int] = []
        self._shown = -1
        self._keep(skin.latest())
        self._thread = threading.Thread(target=self._make, name="skinbus-view", daemon=True)
        self._thread.start()

    @property
    def n_cycles(self) -> int:
        """Cycles there are so far."""
        return len(self._times)

    @property
    def is_complete(self) -> bool:
        """Whether all cycles are there."""
        return not self._thread.is_alive()

    @property
    def length_s(self) -> float:
        """Time from the first cycle to the last so far, s."""
        return self.seconds_of(self.n_cycles - 1)

    @property
    def number(self) -> int:
        """Number of the cycle where it stands, from 0."""
        return self._at(self.seconds)

    @property
    def has_ended(self) -> bool:
        """Whether it stands at the end of a recording that is complete."""
        return self.is_complete and self.number >= self.n_cycles - 1

    @property
    def newest(self) -> Cycle:
        """The cycle where it stands."""
        number = self.number
        first = self._shown + 1
        if not 0 < first <= number + 1:  # another time: the last twenty seconds anew
            self.history = History()
            first = self._at(max(self.seconds_of(number) - 1e-9 * SPAN_NS, 0.0))
        for k in range(first, number + 1):
            self.history.take(self[k])
        self._shown = number
        return self[number]

    def __getitem__(self, number: int) -> Cycle:
        """Return a cycle; its own number counts from 1."""
        return self._cycles[number]

    def seconds_of(self, number: int) -> float:
        """Return when a cycle was, s after the first."""
        return 1e-9 * (self._times[number] - self._times[0])

    def advance(self, elapsed_s: float) -> None:
        """Let time go on, as far as the recording is made."""
        if self.is_playing:
            self.seek(self.seconds + self.speed * elapsed_s)
            self.is_playing = not self.has_ended

    def seek(self, seconds: float) -> None:
        """Go to a time."""
        self.seconds = min(max(seconds, 0.0), self.length_s)

    def step(self, n: int) -> None:
        """Stand still, and go on by cycles."""
        self.is_playing = False
        self.seconds = self.seconds_of(min(max(self.number + n, 0), self.n_cycles - 1))

    def play(self) -> None:
        """Go on, from the begin where it stands at the end."""
        if self.has_ended:
            self.seconds = 0.0
        self.is_playing = True

    def close(self) -> None:
        """Stop."""
        self._skin.close()
        self._thread.join()

    def _at(self, seconds: float) -> int:
        """Return the number of the last cycle at so many seconds after the first."""
        return max(bisect.bisect_right(self._times, self._times[0] + round(1e9 * seconds)) - 1, 0)

    def _make(self) -> None:
        try:
            for cycle in self._skin:
                self._keep(cycle)
        except Exception as error:  # noqa: BLE001 - shown on the page
            self.error = error

    def _keep(self, cycle: Cycle) -> None:
        pressures = cycle.readings.pressures.astype(np.float32)
        cycle.readings = replace(cycle.readings, pressures=pressures)  # type: ignore[arg-type]
        self._cycles.append(cycle)
        self._times.append(cycle.t_ns)
