"""The estimator's time, side by side with SciPy's K-means in one run, and within its budget.

python -m pytest tests/bench/test_estimate_speed.py --benchmark-enable -s
Figures are printed; in the suite each runs a few rounds, to see that it runs.
"""

import time

import numpy as np
import pytest
from scipy.cluster.vq import kmeans2

from skinbus.estimate import Estimator, monotonic_clock
from skinbus.model import Arm, Cone
from skinbus.study.cases import Case
from tests.oracle import cases
from tests.oracle.arms import forearm

pytestmark = pytest.mark.slow

SIGMA = 200.0
TOUCHES = [(0.025, 0.0), (0.0255, 0.1275), (0.051, -0.1), (0.077, 0.0765), (0.128, -0.05)]
"""(s, a) in m: the second and third on seams."""


def pressures_of(arm, touches, force, rng):
    """(n_tactels,) Pa of cones at (s, a), with noise."""
    law, surface = Cone(), arm.links[0].surface
    clean = sum(law.pressure(surface.distance(arm.tactel_s, arm.tactel_a, s, a), force) for s, a in touches)
    return clean + SIGMA * rng.standard_normal(arm.n_tactels)


def timed_us(function, *args, **settings):
    """Time of this thread: what other programs take is no property of a function."""
    begin = time.thread_time_ns()
    function(*args, **settings)
    return (time.thread_time_ns() - begin) / 1e3


@pytest.fixture
def n_rounds(benchmark):
    """Many rounds when benchmarks are asked for, few in the suite."""
    return 4 if benchmark.disabled else 300


def test_fit_of_a_contact_on_each_of_126_patches(benchmark, n_rounds):
    whole = forearm(rings=16)
    arm = Arm("126 patches", whole.links, whole.patches[:126])
    rng = np.random.default_rng(1)
    films = []
    for _ in range(8):
        at = [
            (p.s + s, p.a + a)
            for p, (s, a) in zip(arm.patches, rng.uniform(-0.01, 0.01, (126, 2)), strict=True)
        ]
        films.append(pressures_of(arm, at, 5.0, rng))
    estimator = Estimator(arm, "fit")
    sixteen = arm.patches[0].patch.tactels_uv
    assert len(estimator.update(films[0], 0)) == 126
    ours, theirs = [], []

    def side_by_side():
        for k in range(n_rounds):
            ours.append(timed_us(estimator.update, films[k % len(films)], k) / 126)
            theirs.append(timed_us(kmeans2, sixteen, 1, minit="points", seed=k))

    benchmark.pedantic(side_by_side, rounds=1)
    a, b = np.percentile(ours, [50, 99]), np.percentile(theirs, [50, 99])
    print(f"\nfit, one contact on each of 126 patches, seed 1, {n_rounds} rounds")
    print(f"us per patch: p50 {a[0]:.2f} p99 {a[1]:.2f}")
    print(f"scipy kmeans2 on the 16 points of a patch, us: p50 {b[0]:.1f} p99 {b[1]:.1f}")
    print(f"ratio: p50 {b[0] / a[0]:.0f} p99 {b[1] / a[1]:.0f}")


@pytest.mark.parametrize("level", ["kmeans", "fit", "full"])
def test_forearm_cycle_with_five_contacts_two_on_seams(benchmark, n_rounds, level):
    arm = cases.arm()
    rng = np.random.default_rng(2)
    films = [pressures_of(arm, TOUCHES, 8.0, rng) for _ in range(16)]
    estimator = Estimator(arm, level)
    assert len(estimator.update(films[0], 0)) == 5
    times = []

    def cycles():
        for k in range(10 * n_rounds):
            times.append(timed_us(estimator.update, films[k % len(films)], k))

    benchmark.pedantic(cycles, rounds=1)
    p50, p99 = np.percentile(times, [50, 99])
    print(f"\n{level}, forearm, 5 contacts, seed 2, {len(times)} cycles, us: p50 {p50:.0f} p99 {p99:.0f}")


@pytest.mark.parametrize("budget_us", [0, 100, 500, 1000])
@pytest.mark.parametrize("law", ["cone", "elastic-radial"])
def test_time_beyond_the_budget(benchmark, n_rounds, law, budget_us):
    """Five touches anywhere on a forearm; by the calibrated law their reaches overlap: one group of five."""
    case = Case("forearm", side=4, law=law, bits=16, seed=3)
    films = [case.trial().pressures for _ in range(40)]
    clock = monotonic_clock()._replace(clock_id=time.CLOCK_THREAD_CPUTIME_ID)
    estimator = Estimator(case.arm, "full", budget_us=budget_us, clock=clock)
    over = []

    def cycles():
        for k in range(n_rounds):
            over.append(timed_us(estimator.update, films[k % len(films)], k) - budget_us)

    benchmark.pedantic(cycles, rounds=1)
    p50, p99 = np.percentile(over, [50, 99])
    print(
        f"\nfull, 5 touches, {law}, budget {budget_us} us, seed 3, beyond it, us: p50 {p50:.0f} p99 {p99:.0f}"
    )
