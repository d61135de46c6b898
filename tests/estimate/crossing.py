"""What becomes of two touches that meet, on real estimates."""

import numpy as np

from skinbus.estimate import Tracker

PERIOD_NS = 20_000_000
SIGMA = 200.0
SPEEDS = (0.1, 0.2, 0.4, 0.7, 1.0)
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


def meet(estimator, speed, seed):
    """Return what becomes of two touches that meet head-on: "kept", "exchanged" or "new" identities."""
    arm = estimator.arm
    surface, law = arm.links[0].surface, arm.patches[0].patch.law
    rng, tracker = np.random.default_rng(seed), Tracker(arm)
    middle = np.array([0.077 + rng.uniform(-0.01, 0.01), rng.uniform(-0.2, 0.2)])
    lean, phase, step = rng.uniform(-0.15, 0.15), rng.uniform(-0.5, 0.5), speed * 1e-9 * PERIOD_NS
    ahead = np.array([np.cos(lean), -np.sin(lean)])  # s, a
    ways = np.array([ahead, -ahead])
    aside = 0.5 * OFFSET * ways[:, ::-1] * (-1.0, 1.0)
    reach = max(REACH, NEAR + APART_CYCLES * step)
    seen = []
    for n in range(-int(reach / step), int(reach / step) + 1):
        way = (n + phase) * step
        places = middle + way * ways + aside
        pressures = SIGMA * rng.standard_normal(arm.n_tactels)
        for s, a in places:
            pressures += law.pressure(arm.distance(slice(None), s, surface.wrap(a)), 8.0)
        t_ns = n * PERIOD_NS
        found = _identities(surface, tracker.update(estimator.update(pressures, t_ns), t_ns), places)
        if len(set(found) - {0}) == 2:
            seen.append(found)
    if set(seen[0]) != set(seen[-1]):
        return "new"
    return "kept" if seen[0] == seen[-1] else "exchanged"


def _identities(surface, tracks, places):
    """Return the identity that is seen at each place, 0 for none."""
    found = []
    rows = np.flatnonzero(tracks.row >= 0)
    for s, a in places:
        d = surface.distance(tracks.s[rows], tracks.a[rows], s, surface.wrap(a))
        found.append(int(tracks.identity[rows[d.argmin()]]) if d.min(initial=FOUND) < FOUND else 0)
    return found
