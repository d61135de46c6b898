"""The time and memory of the estimator, beside SciPy's K-means: the last table of docs/estimator.md.

Time is that of the thread: what other programs take is no property of a function. It is still longer on a
busy machine, whose caches others fill; so both sides of a comparison are run in turn.
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.cluster.vq import kmeans2

from skinbus.estimate import LEVELS, Estimator
from skinbus.model import Arm, Cone
from skinbus.study.cases import NOISE
from skinbus.study.skin_models import cone_forearm

Floats = npt.NDArray[np.float64]

PATCHES: Final = 126
"""As many as a bus has node-IDs for."""
TOUCHES: Final = ((0.025, 0.0), (0.0255, 0.1275), (0.051, -0.1), (0.077, 0.0765), (0.128, -0.05))
"""(s, a) in m on a forearm: the second and third on seams."""
MUST_RATIO: Final = 100.0
MUST_FULL_US: Final = 1000.0
MUST_GROWTH: Final = 16 * 1024
"""Bytes; Python itself keeps that much."""
CYCLES: Final = 10_000


@dataclass(frozen=True, slots=True)
class Times:
    """What was measured; times in us as (median, 99th percentile)."""

    patch: dict[str, tuple[float, float]]
    """Per patch, one contact on each of 126, by level."""
    scipy: tuple[float, float]
    """kmeans2 on the 16 points of a patch."""
    forearm: dict[str, tuple[float, float]]
    """One cycle of a forearm with five contacts, two of them on seams, by level."""
    growth: int
    """Bytes that 10 000 cycles of level full have left behind."""

    @property
    def ratio(self) -> float:
        """How many times SciPy's median is that of level fit per patch."""
        return self.scipy[0] / self.patch["fit"][0]

    def missed(self) -> list[str]:
        """Return a line for every limit that is missed."""
        found = []
        if self.ratio < MUST_RATIO:
            found.append(f"fit per patch: {self.ratio:.0f} times as fast as kmeans2, must {MUST_RATIO:.0f}")
        if self.forearm["full"][0] >= MUST_FULL_US:
            found.append(f"full, forearm: {self.forearm['full'][0]:.0f} us, must {MUST_FULL_US:.0f}")
        if self.growth > MUST_GROWTH:
            found.append(f"memory: {self.growth} bytes more, must {MUST_GROWTH}")
        return found


def measure_times(seed: int, rounds: int = 300, cycles: int = CYCLES) -> Times:
    """Return the times of all levels on this machine."""
    rng = np.random.default_rng(seed)
    whole = cone_forearm(rings=16)
    many = Arm("126 patches", whole.links, whole.patches[:PATCHES])
    films = []
    for _ in range(8):
        offsets = rng.uniform(-0.01, 0.01, (PATCHES, 2))
        films.append(_pressures(many, np.column_stack([many.patch_s, many.patch_a]) + offsets, 5.0, rng))
    sixteen = many.patches[0].patch.tactels_uv
    estimators = {level: Estimator(many, level) for level in LEVELS}
    patch: dict[str, list[float]] = {level: [] for level in LEVELS}
    theirs = []
    for level, estimator in estimators.items():
        for k in range(rounds):  # one after the other: each finds the caches full of the other's
            patch[level].append(_timed_us(estimator.update, films[k % len(films)], k) / PATCHES)
            theirs.append(_timed_us(kmeans2, sixteen, 1, minit="points", seed=k))

    arm = cone_forearm(rings=3)
    films = [_pressures(arm, np.array(TOUCHES), 8.0, rng) for _ in range(16)]
    estimators = {level: Estimator(arm, level) for level in LEVELS}
    forearm: dict[str, list[float]] = {level: [] for level in LEVELS}
    for k in range(10 * rounds):
        for level, estimator in estimators.items():
            forearm[level].append(_timed_us(estimator.update, films[k % len(films)], k))
    return Times(
        patch={level: _percentiles(times) for level, times in patch.items()},
        scipy=_percentiles(theirs),
        forearm={level: _percentiles(times) for level, times in forearm.items()},
        growth=_growth(estimators["full"], films, cycles),
    )


def write_times(times: Times) -> str:
    """Return the table in Markdown."""
    rows = [
        f"| {level}, one contact on each of 126 patches, per patch | {p50:.2f} | {p99:.2f} |"
        for level, (p50, p99) in times.patch.items()
    ]
    rows.append(f"| `scipy.cluster.vq.kmeans2`, the 16 points of a patch | {_pair(times.scipy, 1)} |")
    rows += [
        f"| {level}, forearm of 24 patches, five contacts, two on seams | {p50:.0f} | {p99:.0f} |"
        for level, (p50, p99) in times.forearm.items()
    ]
    lines = ["### Time", "", "| what | median us | p99 us |", "|---|---|---|", *rows, ""]
    ratios = ", ".join(f"{level} {times.scipy[0] / p50:.0f}" for level, (p50, _) in times.patch.items())
    lines.append(f"Times as fast as `kmeans2`, per patch: {ratios} (fit ≥ {MUST_RATIO:.0f}).")
    lines.append(f"Memory after {CYCLES} cycles of full: {times.growth} bytes more (≤ {MUST_GROWTH}).")
    lines += [f"**missed**: {line}" for line in times.missed()]
    return "\n".join([*lines, ""])


def _pair(times: tuple[float, float], digits: int) -> str:
    return f"{times[0]:.{digits}f} | {times[1]:.{digits}f}"


def _pressures(arm: Arm, places: Floats, force: float, rng: np.random.Generator) -> Floats:
    """Return (n_tactels,) Pa of cones at (s, a), with noise."""
    law, surface = Cone(), arm.links[0].surface
    d = surface.distance(arm.tactel_s, arm.tactel_a, places[:, :1], places[:, 1:])
    return np.asarray(law.pressure(d, force).sum(axis=0) + NOISE * rng.standard_normal(arm.n_tactels))


def _timed_us(function: Callable[..., Any], *args: Any, **settings: Any) -> float:
    begin = time.thread_time_ns()
    function(*args, **settings)
    return (time.thread_time_ns() - begin) / 1e3


def _percentiles(values: list[float]) -> tuple[float, float]:
    p50, p99 = np.percentile(values, [50, 99])
    return float(p50), float(p99)


def _growth(estimator: Estimator, films: list[Floats], cycles: int) -> int:
    for k in range(64):
        estimator.update(films[k % len(films)], k)
    tracemalloc.start()
    try:
        for k in range(64):
            estimator.update(films[k % len(films)], k)
        before = tracemalloc.get_traced_memory()[0]
        for k in range(cycles):
            estimator.update(films[k % len(films)], k)
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
