"""The compiled cycle of the tracker: invariances, long runs, and no allocation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.runtime import _nrt_python, rtsys

from skinbus.estimate.tracking.tracker import Tracker
from tests.estimate.tracking.track_rig import ARM, PERIOD_NS, SURFACES, contacts, run_long

FLOATS = st.floats(0.0, 1.0)


SEEDS = st.integers(0, 2**32 - 1)


def play(rng_seed, n_cycles=30, order=None, shift=0.0, t0=0):
    """Run three wandering contacts on the cylinder; return the columns that must not change."""
    rng = np.random.default_rng(rng_seed)
    tracker = Tracker(ARM)
    place = rng.uniform([0.05, -0.15, 1.0], [0.35, 0.15, 9.0], (3, 3))
    out = []
    for n in range(n_cycles):
        place[:, :2] += rng.normal(size=(3, 2)) * 3e-3
        seen = rng.random(3) < 0.9
        rows = [(0, s, float(SURFACES[0].wrap(a + shift)), f) for s, a, f in place[seen]]
        if order is not None:
            rows = [rows[i] for i in np.random.default_rng(order + n).permutation(len(rows))]
        t = tracker.update(contacts(*rows), t0 + n * PERIOD_NS)
        out.append((t.identity, t.id, t.slot, t.state, t.mean, t.covariance))
    return out


@pytest.mark.slow
@given(SEEDS, SEEDS)
def test_order_of_contacts_changes_no_bit(seed, order):
    for a, b in zip(play(seed), play(seed, order=order), strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


@given(SEEDS, st.integers(-(10**18), 10**18))
def test_time_of_day_changes_no_bit(seed, t0):
    for a, b in zip(play(seed), play(seed, t0=t0), strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


@given(SEEDS, FLOATS)
def test_shift_around_the_cylinder_shifts_the_tracks(seed, turn):
    surface = SURFACES[0]
    shift = turn * surface.period
    for a, b in zip(play(seed), play(seed, shift=shift), strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(a[:4], b[:4], strict=True))
        moved = a[4].copy()
        moved[:, 1] += shift
        error = b[4] - moved
        error[:, 1] = surface.wrap(error[:, 1])
        assert np.abs(error).max(initial=0.0) < 1e-9
        assert np.allclose(a[5], b[5], rtol=1e-6, atol=0.0)


@pytest.mark.parametrize("n_steps", [2_000, pytest.param(200_000, marks=pytest.mark.slow)])
def test_covariance_stays_positive_definite_for_long(n_steps):
    assert run_long(n_steps) == (n_steps, 0)


def test_cycle_allocates_nothing_in_the_kernel():
    # Going into compiled code wraps each buffer once; how long it stays there must not matter.
    run_long(10)  # compiled, if it was not
    _nrt_python.memsys_enable_stats()
    counts = []
    for n_steps in (10, 2000):
        before = rtsys.get_allocation_stats().alloc
        run_long(n_steps)
        counts.append(rtsys.get_allocation_stats().alloc - before)
    assert counts[0] == counts[1]
