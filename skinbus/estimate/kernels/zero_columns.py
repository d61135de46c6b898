"""The columns of a baseline: what its kernels read and write, per tactel and per patch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Touches = npt.NDArray[np.int8]


class Zeros(NamedTuple):
    """Columns per tactel (n,) and per patch (p,)."""

    start: Ints  # (p + 1,) first tactel of each patch
    beside_start: Ints  # (p + 1,) where the adjoining patches of each begin in
    beside: Ints
    healthy: Bools  # (n,)
    most: Floats  # (n,) Pa, beyond any count: what is read further from 0 counts as this
    full: Floats  # (n,) Pa, full scale
    touch: Floats  # (n,) Pa
    ratio: Floats  # (n,) release over touch
    declared: Floats  # (n,) Pa
    band: Floats  # (n,) Pa, half width of the zero band
    drift: Floats  # (n,) Pa^2/s, growth of a zero's variance while it cannot be observed
    centre: Floats  # (n,) Pa, of the zero band
    zero: Floats  # (n,) Pa
    doubt: Floats  # (n,) Pa^2, variance of the zero
    common: Floats  # (p,) Pa^2, variance of what the zeros of a board have in common
    pressed: Floats  # (n,) Pa, what has pressed: rises within a second, decays in twenty
    creep: Floats  # (n,) Pa, standard deviation of what the cover may still show of it
    variance: Floats  # (n,) Pa^2, of the noise: the larger of the next two
    below: Floats  # (n,) Pa^2, by readings below the zero
    quick: Floats  # (n,) Pa^2, by second differences
    touched: Touches  # (n,) FREE, TOUCHED or HELD
    zeroed: Bools  # (n,) has a zero from readings
    out: Bools  # (n,) out of the zero band
    run: Ints  # (n,) readings in a row across the border of the band
    low_run: Ints  # (n,) readings in a row below the zero
    low_sum: Floats  # (n,) Pa, of them
    low_s: Floats  # (n,) s, of them
    mean: Floats  # (n,) of the window
    n_read: Ints  # (n,) readings of the window
    square: Floats  # (n,) sum of squared deviations of the window
    was_touched: Bools  # (n,) in the window
    last: Floats  # (n,) Pa, as read last
    earlier: Floats  # (n,) Pa, as read before that; NaN while it has no zero and is touched
    second: Floats  # (n,) Pa, second difference of the last three readings of one that has a zero
    n_first: Ints  # (n,) readings of which the noise is a mean, while it has no zero
    first_variance: Floats  # (n,) Pa^2, of the noise, by them
    noise_s: Floats  # (n,) s, time of which the noise is a mean, at most ``NOISE_S``
    seen: Bools  # (n,) read in this cycle
    patch_touched: Bools  # (p,)
    explained: Bools  # (p,) drift explains what the last window has read
    silent_s: Floats  # (p,) since it was read
    own_quiet_s: Floats  # (p,) since the last touch here
    quiet_s: Floats  # (p,) since the last touch here or beside
    window: Ints  # (p,) OFF, START or REST
    window_s: Floats  # (p,)
    window_n: Ints  # (p,)
    pending: Ints  # (p,) tactels that have no zero
