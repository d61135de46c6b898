"""Presses in a recording: where readings stand still under a touch, joined by time with poses and forces.

The clocks of skin, robot and force sensor differ by an unknown offset. It is the lag of the largest
correlation between the load of the skin and a signal of the other clock that rises under a press: the force,
or how near the tool is and how still it stands. Parts of the recording give it one by one; their scatter is
its uncertainty.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.signal import correlate, correlation_lags

Floats = npt.NDArray[np.float64]

STEP_S = 0.005
"""Of the signals that are correlated: finer than the cycles of any skin, which are 1 to 20 ms."""
PARTS = 6
"""Of a recording that give the offset one by one."""
ALIKE = 0.3
"""Least correlation of a part that says something of the offset."""
MAX_OFFSET_S = 120.0
"""Clocks that differ by more are no clocks of one experiment, unless the search begins elsewhere."""
SLOW = 2e-3
"""m/s: half of a tool that stands still by the noise of its pose; one that travels does 20 to 500 mm/s."""
NEAR = 1e-3
"""m over the surface: half of a tool that touches."""
PRESSED = 0.1
"""Part of a strong load from which something presses."""
STEADY = 0.03
"""Relative change of the load over ``WINDOW_S`` below which a press is held."""
SURE = 3.0
"""Standard deviations of noise that a change has to exceed, too."""
WINDOW_S, SHORTEST_S = 0.1, 0.15
"""s: over which steadiness is judged, and the shortest hold; ten cycles of a usual skin."""


class ClockOffset(NamedTuple):
    """What to add to times of another clock to get those of the skin, s; its sd; the correlation there."""

    s: float
    sd: float
    correlation: float


class Hold(NamedTuple):
    """A press that is held: from one time of the skin to another, s."""

    begin: float
    end: float


def pose_signal(t: Floats, s: Floats, a: Floats, height: Floats | None) -> Floats:
    """Return (n,) from 0 to 1, large where a tool stands still and near; t in s, places in m."""
    speed = np.hypot(np.gradient(s, t), np.gradient(a, t))
    width = max(1, round(WINDOW_S / max(float(np.median(np.diff(t))), 1e-6)))
    speed = np.convolve(np.pad(speed, width // 2, mode="edge"), np.ones(width) / width, "same")
    speed = speed[width // 2 : width // 2 + len(t)]
    still = 1.0 / (1.0 + (speed / SLOW) ** 2)
    if height is None:
        return np.asarray(still)
    return np.asarray(still / (1.0 + np.exp(np.clip((height - NEAR) / (0.3 * NEAR), -50.0, 50.0))))


def find_offset(t: Floats, load: Floats, t_other: Floats, other: Floats) -> ClockOffset:
    """Return the offset of another clock; load (n,) at t, other (m,) at t_other, both rising under a press.

    Raises:
        ValueError: one of the signals does not change, or nothing agrees.
    """
    grid, there = np.arange(t[0], t[-1], STEP_S), np.arange(t_other[0], t_other[-1], STEP_S)
    mine, theirs = np.interp(grid, t, load), np.interp(there, t_other, other)
    if len(grid) < 10 or len(there) < 10 or not mine.std() > 0.0 or not theirs.std() > 0.0:
        raise ValueError("a signal without a press in it")
    # both without their means, so that a long rest counts nothing
    mine = np.sqrt(np.maximum(mine, 0.0))
    mine, theirs = mine - mine.mean(), theirs - theirs.mean()
    lags = correlation_lags(len(mine), len(theirs)) * STEP_S
    allowed = np.abs(lags) <= MAX_OFFSET_S + (grid[-1] - grid[0])
    agree = np.where(allowed, correlate(mine, theirs, method="fft"), -np.inf)
    best = int(agree.argmax())
    offset = float(lags[best] + grid[0] - there[0])
    correlation = float(agree[best] / np.sqrt((mine @ mine) * (theirs @ theirs)))
    tried = np.arange(-0.5, 0.5, STEP_S)
    own = []
    for part in np.array_split(np.arange(len(grid)), PARTS):
        scores = [_going(mine[part], np.interp(grid[part] - offset - one, there, theirs)) for one in tried]
        if max(scores) >= ALIKE:
            own.append(float(tried[int(np.argmax(scores))]))
    sd = float(np.std(own, ddof=1) / np.sqrt(len(own))) if len(own) > 2 else STEP_S
    return ClockOffset(offset, max(sd, STEP_S / np.sqrt(12.0)), correlation)


def _going(mine: Floats, theirs: Floats) -> float:
    """Return how signals go together, 0 where one does not change."""
    return float(np.corrcoef(mine, theirs)[0, 1]) if np.ptp(mine) > 0.0 and np.ptp(theirs) > 0.0 else 0.0


def load_of(pressures: Floats, threshold: Floats) -> Floats:
    """Return the load of a skin over time (n,) Pa: the sum of what is above half of the touch threshold.

    pressures: (n, n_tactels) Pa, NaN where nothing was read; threshold: (n_tactels,) Pa. What is below is
    noise, which would add up over the tactels of an arm to more than a press.
    """
    return np.asarray(np.where(pressures > 0.5 * threshold, pressures, 0.0).sum(axis=1))


def find_holds(t: Floats, load: Floats) -> list[Hold]:
    """Return the presses that are held; load (n,) at times t (n,) s."""
    strong = float(np.quantile(load[load > 0.0], 0.9)) if (load > 0.0).any() else 0.0
    half = max(1, round(0.5 * WINDOW_S / max(float(np.median(np.diff(t))), 1e-6)))
    pressed = load > max(PRESSED * strong, 1e-300)
    # the mean of what follows less that of what precedes: noise is as small as the window is long
    means = np.convolve(np.pad(load, half, mode="edge"), np.ones(half) / half, "valid")
    change = np.abs(means[half + 1 : half + 1 + len(load)] - means[: len(load)])
    steps = np.diff(load)[pressed[1:] & pressed[:-1]]
    noise = 1.4826 * float(np.median(np.abs(steps))) / np.sqrt(half) if len(steps) else 0.0
    held = pressed & (change < np.maximum(STEADY * load, SURE * noise))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], held, [False]]).astype(np.int8)))
    return [
        Hold(float(t[begin]), float(t[end - 1]))
        for begin, end in zip(edges[::2], edges[1::2], strict=True)
        if t[end - 1] - t[begin] >= SHORTEST_S
    ]
