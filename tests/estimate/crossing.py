"""What becomes of two touches that meet, on real estimates: by speed, angle, level and law.

python -m tests.estimate.crossing [N_SEEDS [LEVEL ...]]
"""

import sys
from collections import Counter

import numpy as np

from skinbus.config.system import load_arm
from skinbus.estimate import Estimator, Tracker
from tests.oracle import cases

PERIOD_NS = 20_000_000
SIGMA = 200.0
SPEEDS = (0.1, 0.2, 0.4, 0.7, 1.0)
REACH = 0.056
"""m: where the touches begin and end, either side of the middle; ..."""
APART_CYCLES = 4
"""... they have moved for so many cycles before they are ..."""
NEAR = 0.02
"""... so near to the middle, m."""
TURN = 0.004
"""m: from the middle, where they turn back."""
FOUND = 0.015
"""A contact further from a touch than this is not that touch, m."""


def meet(estimator, speed, *, turns=False, force=8.0, seed=0, period_ns=PERIOD_NS, angle=np.pi, offset=0.004):
    """Return what becomes of touches of 8 N and ``force``: "kept", "exchanged", or "new", identities lost.

    angle:  between their ways, rad; pi is head-on
    offset: how far off they pass each other, m
    """
    arm = estimator.arm
    surface, law = arm.links[0].surface, arm.patches[0].patch.law
    rng, tracker = np.random.default_rng(seed), Tracker(arm)
    middle = np.array([0.077 + rng.uniform(-0.01, 0.01), rng.uniform(-0.2, 0.2)])
    lean, phase, step = rng.uniform(-0.15, 0.15), rng.uniform(-0.5, 0.5), speed * 1e-9 * period_ns
    ways = np.array([_ahead(lean + 0.5 * angle), _ahead(lean - 0.5 * angle)])
    aside = 0.5 * offset * ways[:, ::-1] * (-1.0, 1.0)
    reach = max(REACH, NEAR + APART_CYCLES * step)
    seen = []
    for n in range(-int(reach / step), int(reach / step) + 1):
        way = (n + phase) * step
        if turns:
            way = -abs(way) - TURN
        places = middle + way * ways + aside
        pressures = SIGMA * rng.standard_normal(arm.n_tactels)
        for (s, a), each in zip(places, (8.0, force), strict=True):
            d = surface.distance(arm.tactel_s, arm.tactel_a, s, surface.wrap(a))
            pressures += law.pressure(d, each)
        t_ns = n * period_ns
        found = _identities(surface, tracker.update(estimator.update(pressures, t_ns), t_ns), places)
        if len(set(found) - {0}) == 2:
            seen.append(found)
    if set(seen[0]) != set(seen[-1]):
        return "new"
    return "kept" if seen[0] == seen[-1] else "exchanged"


def _ahead(angle):
    """Return the unit vector (s, a) at an angle from around the arm."""
    return np.array([np.sin(angle), np.cos(angle)])


def _identities(surface, tracks, places):
    """Return the identity that is seen at each place, 0 for none."""
    found = []
    rows = np.flatnonzero(tracks.row >= 0)
    for s, a in places:
        d = surface.distance(tracks.s[rows], tracks.a[rows], s, surface.wrap(a))
        found.append(int(tracks.identity[rows[d.argmin()]]) if d.min(initial=FOUND) < FOUND else 0)
    return found


CROSSINGS = {"head-on": np.pi, "at 135 degrees": 0.75 * np.pi, "at 90 degrees": 0.5 * np.pi}


def main():
    n_seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    arms = {"cone": cases.arm(), "law that ships": load_arm("forearm")}
    for level in sys.argv[2:] or ("kmeans", "fit", "full"):
        for law, arm in arms.items():
            estimator = Estimator(arm, level)
            for turns in (False, True):
                for what, angle in CROSSINGS.items() if not turns else (("turn back", np.pi),):
                    for speed in SPEEDS:
                        ends = Counter(
                            meet(estimator, speed, turns=turns, seed=seed, angle=angle)
                            for seed in range(n_seeds)
                        )
                        print(f"{level}, {law}, {what}, {speed} m/s each: {dict(ends)}", flush=True)


if __name__ == "__main__":
    main()
