"""Presses in a recording: where readings stand still under a touch, joined by time with poses and forces.

The clocks of skin, robot and force sensor differ by an unknown offset. It is the lag of the largest
correlation between the load of the skin and a signal of the other clock that rises under a press: the force,
or how near the tool is and how still it stands.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import correlate, correlation_lags

from skinbus.arrays import Floats

STEP_S = 0.005
"""Of the signals that are correlated: finer than the cycles of any skin, which are 1 to 20 ms."""
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
    """What to add to times of another clock to get those of the skin, s; the correlation there."""

    s: float
    correlation: float


class Hold(NamedTuple):
    """A press that is held: from one time of the skin to another, s."""

    begin: float
    end: float


def _window(t: Floats) -> int:
    """Return the samples of half a window."""
    return max(1, round(0.5 * WINDOW_S / max(float(np.median(np.diff(t))), 1e-6)))


def pose_signal(t: Floats, s: Floats, a: Floats, height: Floats | None) -> Floats:
    """Return (n,) from 0 to 1, large where a tool stands still and near; t in s, places in m."""
    speed = uniform_filter1d(np.hypot(np.gradient(s, t), np.gradient(a, t)), 2 * _window(t), mode="nearest")
    still = 1.0 / (1.0 + (speed / SLOW) ** 2)
    if height is None:
        return still
    return still / (1.0 + np.exp(np.clip((height - NEAR) / (0.3 * NEAR), -50.0, 50.0)))


def find_offset(t: Floats, load: Floats, t_other: Floats, other: Floats) -> ClockOffset:
    """Return the offset of another clock; load (n,) at t, other (m,) at t_other, both rising under a press.

    Raises:
        ValueError: one of the signals does not change.
    """
    grid, there = np.arange(t[0], t[-1], STEP_S), np.arange(t_other[0], t_other[-1], STEP_S)
    mine, theirs = np.sqrt(np.maximum(np.interp(grid, t, load), 0.0)), np.interp(there, t_other, other)
    if len(grid) < 10 or len(there) < 10 or not mine.std() > 0.0 or not theirs.std() > 0.0:
        raise ValueError("a signal without a press in it")
    # both without their means, so that a long rest counts nothing
    mine, theirs = mine - mine.mean(), theirs - theirs.mean()
    agree = correlate(mine, theirs, method="fft")
    best = int(agree.argmax())
    lag = float(correlation_lags(len(mine), len(theirs))[best] * STEP_S)
    correlation = float(agree[best] / np.sqrt((mine @ mine) * (theirs @ theirs)))
    return ClockOffset(lag + float(grid[0] - there[0]), correlation)


def load_of(pressures: Floats, threshold: Floats) -> Floats:
    """Return the load of a skin over time (n,) Pa: the sum of what is above half of the touch threshold.

    pressures: (n, n_tactels) Pa, NaN where nothing was read; threshold: (n_tactels,) Pa. What is below is
    noise, which would add up over the tactels of an arm to more than a press.
    """
    return np.asarray(np.where(pressures > 0.5 * threshold, pressures, 0.0).sum(axis=1))


def find_holds(t: Floats, load: Floats) -> list[Hold]:
    """Return the presses that are held; load (n,) at times t (n,) s."""
    strong, half = float(np.quantile(load[load > 0.0], 0.9)) if (load > 0.0).any() else 0.0, _window(t)
    pressed = load > max(PRESSED * strong, 1e-300)
    # the mean of what follows less that of what precedes: noise is as small as the window is long
    before, after = (
        uniform_filter1d(load, half, mode="nearest", origin=k) for k in ((half - 1) // 2, -(half // 2))
    )
    change = np.abs(after - before)
    steps = np.diff(load)[pressed[1:] & pressed[:-1]]
    noise = 1.4826 * float(np.median(np.abs(steps))) / np.sqrt(half) if len(steps) else 0.0
    held = pressed & (change < np.maximum(STEADY * load, SURE * noise))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], held, [False]]).astype(np.int8)))
    return [
        Hold(float(t[begin]), float(t[end - 1]))
        for begin, end in edges.reshape(-1, 2)
        if t[end - 1] - t[begin] >= SHORTEST_S
    ]
