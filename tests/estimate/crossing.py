"""What becomes of two touches that cross or turn back, on real estimates.

python -m tests.estimate.crossing [LEVEL ...]
"""

import sys
from collections import Counter

import numpy as np

from skinbus.estimate import LEVELS, Estimator, Tracker
from tests.oracle import cases

PERIOD_NS = 20_000_000
SIGMA = 200.0
SPEEDS = (0.05, 0.1, 0.2, 0.4)
REACH = 0.056
"""m: where the touches begin and end, either side of the middle."""
OFFSET = 0.004
"""m: how far off they pass each other."""
TURN = 0.004
"""m: from the middle, where they turn back."""


def meet(estimator, speed, *, turns=False, force=8.0, seed=0):
    """Return "kept", "exchanged", or "new" (identities were lost), of touches of 8 N and ``force``."""
    arm = estimator.arm
    surface, law = arm.links[0].surface, arm.patches[0].patch.law
    rng, tracker = np.random.default_rng(seed), Tracker(arm)
    middle = rng.uniform(-0.2, 0.2)
    n_half = int(REACH / (speed * 1e-9 * PERIOD_NS))
    orders = []
    for n in range(-n_half, n_half + 1):
        way = speed * 1e-9 * PERIOD_NS * n
        if turns:
            way = -abs(way) - TURN
        pressures = SIGMA * rng.standard_normal(arm.n_tactels)
        for s, a, each in ((0.077, middle + way, 8.0), (0.077 + OFFSET, middle - way, force)):
            d = surface.distance(arm.tactel_s, arm.tactel_a, s, surface.wrap(a))
            pressures += law.pressure(d, each)
        t_ns = (n + n_half + 1) * PERIOD_NS
        tracks = tracker.update(estimator.update(pressures, t_ns), t_ns)
        seen = np.flatnonzero(tracks.row >= 0)
        order = tracks.identity[seen[np.argsort(surface.wrap(tracks.a[seen] - middle))]].tolist()
        if len(order) == 2:
            orders.append(order)
    first, last = orders[0], orders[-1]
    if sorted(first) != sorted(last):
        return "new"
    return "kept" if (first == last) == turns else "exchanged"


def main():
    arm = cases.arm()
    for level in sys.argv[1:] or LEVELS:
        estimator = Estimator(arm, level)
        for turns in (False, True):
            for speed in SPEEDS:
                ends = Counter(meet(estimator, speed, turns=turns, seed=seed) for seed in range(20))
                what = "turn back" if turns else "cross"
                print(f"{level}: two that {what} at {speed} m/s, seeds 0-19: {dict(ends)}", flush=True)


if __name__ == "__main__":
    main()
