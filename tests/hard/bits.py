"""What every kernel of the estimator makes of a few inputs, as numbers on standard output: one JSON object.

Run by ``test_same_bits`` with and without compilation: `python -m tests.hard.bits`. With `--strict`, which
only works uncompiled, no index may be below 0 or beyond the end of any array of the kernels. The same with
numba's own check takes minutes to compile: `NUMBA_BOUNDSCHECK=1 NUMBA_OPT=0 python -m tests.hard.bits`.
"""

import json
import sys

import numpy as np

from skinbus.estimate import Baseline, Estimator, Tracker
from skinbus.estimate.kernels.array_table import array_table
from skinbus.estimate.tracking.assignment import assign, make_assign_work
from tests.hard.ground import Ground, pressures_under, touch
from tests.inner_kernels import from_python

PERIOD_NS = 20_000_000
WORK = 40_000
"""Pressures evaluated in a cycle: the usual ones take half of it. What nothing explains, the broken one,
would take millions, and uncompiled that is minutes."""
STRICT = "--strict" in sys.argv


class Strict(np.ndarray):
    """An array that takes no index from behind: compiled code would not raise for one beyond the front."""

    def _check(self, key):
        for axis, index in enumerate(key if isinstance(key, tuple) else (key,)):
            if isinstance(index, int | np.integer) and not 0 <= index < self.shape[axis]:
                raise IndexError(f"index {index} of {self.shape[axis]}")

    def __getitem__(self, key):
        self._check(key)
        return super().__getitem__(key)

    def __setitem__(self, key, value):
        self._check(key)
        super().__setitem__(key, value)


def strict(columns):
    """The same columns, every array strict if that is asked for; else what kernels take instead of them."""
    if not STRICT:
        return array_table(columns)
    return columns._replace(**{name: value.view(Strict) for name, value in columns._asdict().items()})


def make_estimator(arm, *args, **settings):
    """An estimator with strict arrays if that is asked for."""
    estimator = Estimator(arm, *args, **settings)
    if STRICT:
        estimator._work = strict(estimator._work)
        estimator._tables = strict(estimator._layout), estimator._work
    return estimator


def readings(arm):
    """A few cycles that go through every branch the usual path has, and some it has not."""
    rng = np.random.default_rng(5)
    n = arm.n_tactels
    yield "one", pressures_under(arm, [touch(arm, 0, 0.002, 0.001, 5.0)]) + 200.0 * rng.standard_normal(n)
    yield "seam", pressures_under(arm, [touch(arm, 0, 0.002, 0.0255, 40.0)]) + 200.0 * rng.standard_normal(n)
    two = [touch(arm, 0, -0.007, 0.002, 6.0), touch(arm, 0, 0.008, 0.003, 5.0)]
    yield "two", pressures_under(arm, two) + 200.0 * rng.standard_normal(n)
    broken = pressures_under(arm, two[:1])
    broken[[3, 9]] = np.nan, 250e3
    yield "broken", broken
    yield "nothing", 200.0 * rng.standard_normal(n)


def contacts_of(level):
    """Columns of the contacts of one level on two boards of each surface and law."""
    out = {}
    for surface, law in (("cylinder", "cone"), ("frustum", "radial")):
        ground = Ground(surface, law)
        arm = ground.mount([ground.arm().patches[0].patch] * 2)
        estimator = make_estimator(arm, "full", budget_work=WORK)
        for name, pressures in readings(arm):
            c = estimator.update(pressures, 1, level=level)
            out[f"{surface} {law} {level} {name}"] = np.concatenate(
                [c.link, c.s, c.a, c.force, c.quality, c.status, c.width, c.residual, c.covariance.ravel()]
            )
    return out


def starts():
    """Columns of K-means from random starts, and from as many as are wanted; a clock is looked at."""
    ground = Ground("plane", "cone")
    arm = ground.mount([ground.arm().patches[0].patch] * 2)
    out = []
    for settings in ({"start": "random", "k": 3, "seed": 4}, {"k": 4}):
        estimator = make_estimator(arm, budget_us=1e9, budget_work=WORK, **settings)
        for _, pressures in readings(arm):
            c = estimator.update(pressures, 1)
            out += [c.s, c.a, c.force, c.n_tactels]
    return np.concatenate(out)


def tracks():
    """States of the tracker over contacts that come, cross and go."""
    ground = Ground("cylinder", "cone")
    arm = ground.mount([ground.arm().patches[0].patch] * 2)
    estimator, tracker = Estimator(arm, "full"), Tracker(arm)
    tracker._work_table, tracker._ground_table = strict(tracker._work), strict(tracker._ground)
    out = []
    for n in range(12):
        x = 0.002 * n - 0.012
        touches = [touch(arm, 0, x, 0.004, 6.0), touch(arm, 1, -x, 0.0, 5.0)][: 1 + (n > 2)]
        pressures = pressures_under(arm, touches if n < 9 else [])
        t = tracker.update(estimator.update(pressures, n, level="kmeans"), n * PERIOD_NS)
        out += [t.identity, t.state, t.mean.ravel(), t.covariance.ravel()]
    return np.concatenate(out)


def zeros():
    """Zeros and noise of the baseline after a start, a drift and a touch."""
    ground = Ground("plane", "cone")
    arm = ground.mount([ground.arm().patches[0].patch] * 2)
    baseline, rng = Baseline(arm), np.random.default_rng(2)
    if STRICT:
        baseline._table = strict(baseline._table)
    for n in range(60):
        pressures = 50.0 + n + 200.0 * rng.standard_normal(arm.n_tactels)
        if n > 45:
            pressures[4] += 2e4
        baseline.apply(pressures, n * PERIOD_NS)
    return np.concatenate([baseline.zeros, baseline.noise, baseline.touched])


def pairs():
    """An assignment with ties."""
    cost = np.random.default_rng(3).integers(0, 4, (6, 9)).astype(float)
    work = make_assign_work(9)
    from_python(assign)(cost, 6, 9, strict(work))
    return work.column_of[:6]


def main():
    """Write everything."""
    out = {}
    for level in ("kmeans", "fit", "full"):
        out |= contacts_of(level)
    out |= {"starts": starts(), "tracks": tracks(), "zeros": zeros(), "pairs": pairs()}
    json.dump({name: [float(v).hex() for v in values] for name, values in out.items()}, sys.stdout)


if __name__ == "__main__":
    main()
