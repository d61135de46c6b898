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

Floats = npt.NDArray[np.float64]

STEP_S = 0.005
"""Of the signals that are correlated: finer than the cycles of any skin, which are 1 to 20 ms."""
PARTS = 6
"""Of a recording that give the offset one by one."""
UNEVEN = 0.7
"""Correlation in a part, by that in the best one, from which they are alike: by one clock it is 0.8 and more
also with a drift of 1000 ppm; one that is set makes it 0.5 at most."""
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
    uneven: tuple[float, float, float] | None = None
    """A part of the recording that goes with the other clock much less than others do: begin and end of it by
    the clock of the skin, s, and the correlation in it."""


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
    grid = np.arange(t[0], t[-1], STEP_S)
    mine = np.interp(grid, t, load)
    there = np.arange(t_other[0], t_other[-1], STEP_S)
    theirs = np.interp(there, t_other, other)
    if len(grid) < 10 or len(there) < 10 or not mine.std() > 0.0 or not theirs.std() > 0.0:
        raise ValueError("a signal without a press in it")
    # the overlap of all lags at once; both without their means, so that a long rest counts nothing
    mine, theirs = np.sqrt(np.maximum(mine, 0.0)), theirs - theirs.mean()
    mine = mine - mine.mean()
    n = len(mine) + len(theirs) - 1
    spectrum = np.fft.rfft(mine, n) * np.conj(np.fft.rfft(theirs, n))
    lags = np.fft.irfft(spectrum, n)
    shift = np.arange(n)
    shift[shift >= len(mine)] -= n
    offsets = shift * STEP_S + (grid[0] - there[0])
    allowed = np.abs(offsets - (grid[0] - there[0])) <= MAX_OFFSET_S + (grid[-1] - grid[0])
    best = int(np.where(allowed, lags, -np.inf).argmax())
    left, right = lags[best - 1], lags[(best + 1) % n]
    bend = left - 2.0 * lags[best] + right
    fine = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    offset = float(offsets[best] + np.clip(fine, -0.5, 0.5) * STEP_S)
    norm = float(np.sqrt((mine @ mine) * (theirs @ theirs)))
    correlation = float(lags[best] / norm)
    own = [
        one
        for part in np.array_split(np.arange(len(grid)), PARTS)
        if (one := _near(grid[part], mine[part], there, theirs, offset)) is not None
    ]
    sd = float(np.std(own, ddof=1) / np.sqrt(len(own))) if len(own) > 2 else STEP_S
    uneven = _uneven(grid, mine, np.interp(grid - offset, there, theirs))
    return ClockOffset(offset, max(sd, STEP_S / np.sqrt(12.0)), correlation, uneven)


def _uneven(t: Floats, mine: Floats, theirs: Floats) -> tuple[float, float, float] | None:
    """Return the worst part of a recording in which signals go together, if it is far worse than most.

    Before the first and after the last press a tool may rest, which looks as if it pressed: that is left out.
    """
    pressed = np.flatnonzero(mine > mine.min() + np.sqrt(PRESSED) * np.ptp(mine))
    parts = np.array_split(np.arange(pressed[0], pressed[-1] + 1), PARTS)
    going = [
        float(np.corrcoef(mine[part], theirs[part])[0, 1]) if np.ptp(theirs[part]) > 0.0 else 0.0
        for part in parts
        if np.ptp(mine[part]) > 0.0
    ]
    if len(going) < len(parts) or min(going) > UNEVEN * max(going):
        return None
    worst = parts[int(np.argmin(going))]
    return float(t[worst[0]]), float(t[worst[-1]]), min(going)


def _near(t: Floats, mine: Floats, there: Floats, theirs: Floats, offset: float) -> float | None:
    """Return the offset by a part of the recording, near that of all, s; None without a press."""
    tried = np.arange(-0.5, 0.5, STEP_S)
    shifted = [np.interp(t - offset - one, there, theirs) for one in tried]
    if not (np.ptp(mine) > 0.0 and all(np.ptp(one) > 0.0 for one in shifted)):
        return None
    scores = [np.corrcoef(mine, one)[0, 1] for one in shifted]
    if max(scores) < 0.3:
        return None
    return float(offset + tried[int(np.argmax(scores))])


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
    sums = np.concatenate([[0.0], np.cumsum(np.pad(load, half, mode="edge"))])
    i = np.arange(len(load))
    before = sums[i + half] - sums[i]
    after = sums[i + 2 * half + 1] - sums[i + half + 1]
    change = np.abs(after - before) / half
    steps = np.diff(load)[pressed[1:] & pressed[:-1]]
    noise = 1.4826 * float(np.median(np.abs(steps))) / np.sqrt(half) if len(steps) else 0.0
    held = pressed & (change < np.maximum(STEADY * load, SURE * noise))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], held, [False]]).astype(np.int8)))
    return [
        Hold(float(t[begin]), float(t[end - 1]))
        for begin, end in zip(edges[::2], edges[1::2], strict=True)
        if t[end - 1] - t[begin] >= SHORTEST_S
    ]
