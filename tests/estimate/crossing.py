"""What becomes of touches that meet in pairs, on real estimates."""

import numpy as np

from skinbus.estimate import Tracker

PERIOD_NS = 20_000_000
SIGMA = 200.0
SPEEDS = (0.1, 0.2, 0.4, 0.7, 1.0)
PAIRS = 4
"""At a time, around the arm: 10 cm from each other, so that none feels the next."""
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
    rng, trackers = np.random.default_rng(seed), [Tracker(arm) for _ in estimators]
    around = rng.uniform(-0.2, 0.2) + surface.period / PAIRS * np.arange(PAIRS)
    middle = np.column_stack([0.077 + rng.uniform(-0.01, 0.01, PAIRS), around])[:, None]
    lean, phase = rng.uniform(-0.15, 0.15, PAIRS), rng.uniform(-0.5, 0.5, (PAIRS, 1, 1))
    ahead, step = np.column_stack([np.cos(lean), -np.sin(lean)]), speed * 1e-9 * PERIOD_NS  # s, a
    ways = np.stack([ahead, -ahead], axis=1)
    aside = 0.5 * OFFSET * ways[..., ::-1] * (-1.0, 1.0)
    n_half = int(max(REACH, NEAR + APART_CYCLES * step) / step)
    cycles = np.arange(-n_half, n_half + 1)
    places = middle + (cycles[:, None, None, None] + phase) * step * ways + aside
    places[..., 1] = surface.wrap(places[..., 1])
    pressures = law.pressure(arm.distance(slice(None), places[..., 0], places[..., 1]), 8.0).sum(axis=(1, 2))
    pressures += SIGMA * rng.standard_normal(pressures.shape)
    seen = [[[] for _ in range(PAIRS)] for _ in estimators]
    for n, felt, at in zip(cycles.tolist(), pressures, places, strict=True):
        t_ns = n * PERIOD_NS
        for estimator, tracker, pairs in zip(estimators, trackers, seen, strict=True):
            tracks = tracker.update(estimator.update(felt, t_ns), t_ns)
            for pair, found in zip(pairs, _identities(surface, tracks, at), strict=True):
                if len(set(found) - {0}) == 2:
                    pair.append(found)
    return [sum(pair[0] == pair[-1] for pair in pairs) for pairs in seen]


def _identities(surface, tracks, places):
    """Return the identities that are seen at places (PAIRS, 2, 2), 0 for none."""
    rows = np.flatnonzero(tracks.row >= 0)
    if not len(rows):
        return np.zeros(places.shape[:2], np.int64).tolist()
    d = surface.distance(tracks.s[rows], tracks.a[rows], places[..., :1], places[..., 1:])
    return np.where(d.min(axis=-1) < FOUND, tracks.identity[rows[d.argmin(axis=-1)]], 0).tolist()
