"""What becomes of touches that meet in pairs, on real estimates."""

import numpy as np

from skinbus.estimate import Tracker

PERIOD_NS = 20_000_000
SIGMA = 200.0
SPEEDS = (0.1, 0.2, 0.4, 0.7, 1.0)
PAIRS, APART = 4, 0.102
"""At a time, and how far apart around the arm, m: none feels the next."""
REACH = 0.056
"""m: where the touches begin and end, either side of the middle; ..."""
APART_CYCLES = 4
"""... they have moved for so many cycles before they are ..."""
NEAR = 0.02
"""... so near to the middle, m."""
OFFSET = 0.004
"""m: how far off they pass each other."""
FOUND = 0.015
"""A contact further from a touch than this is not that touch, m."""


def meet(estimators, speed, seed):
    """Return how many of ``PAIRS`` pairs of touches that meet head-on keep their identities, by estimator."""
    arm = estimators[0].arm
    surface, law = arm.links[0].surface, arm.patches[0].patch.law
    rng, step = np.random.default_rng(seed), speed * 1e-9 * PERIOD_NS
    # s + ia, m
    middle = 0.077 + rng.uniform(-0.01, 0.01, PAIRS) + 1j * (rng.uniform(0.0, 0.4) + np.arange(PAIRS) * APART)
    ahead, phase = np.exp(-1j * rng.uniform(-0.15, 0.15, PAIRS)), rng.uniform(-0.5, 0.5, PAIRS)
    n_half = int(max(REACH, NEAR + APART_CYCLES * step) / step)
    cycles = np.arange(-n_half, n_half + 1)
    way = ((cycles[:, None] + phase) * step + 0.5j * OFFSET) * ahead
    places = np.stack([middle + way, middle - way], -1)
    s, a = places.real, surface.wrap(places.imag)
    pressures = law.pressure(arm.distance(slice(None), s, a), 8.0).sum(axis=(1, 2))
    pressures += SIGMA * rng.standard_normal(pressures.shape)
    n_kept = []
    for estimator in estimators:
        tracker, seen = Tracker(arm), np.zeros(s.shape, np.int64)
        for n, now in enumerate((PERIOD_NS * cycles).tolist()):
            tracks = tracker.update(estimator.update(pressures[n], now), now)
            d = surface.distance(tracks.s[:, None], tracks.a[:, None], s[n].ravel(), a[n].ravel())
            is_seen = (tracks.row >= 0) & (d.min(axis=1) < FOUND)
            seen[n].flat[d.argmin(axis=1)[is_seen]] = tracks.identity[is_seen]
        pairs = [pair[pair.all(axis=1)] for pair in seen.swapaxes(0, 1)]
        n_kept.append(sum(np.array_equal(pair[0], pair[-1]) for pair in pairs))
    return n_kept
