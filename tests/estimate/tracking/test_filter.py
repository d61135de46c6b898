"""The numbers of tracks: filter and assignment against oracles, invariances, long runs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.runtime import _nrt_python, rtsys
from scipy.optimize import linear_sum_assignment

from skinbus.estimate.tracking import filter as kalman
from skinbus.estimate.tracking.assignment import assign, make_assign_work
from skinbus.estimate.tracking.tracker import Tracker
from tests.estimate.tracking.track_rig import ARM, PERIOD_NS, SURFACES, Film, contacts, run_long

FLOATS = st.floats(0.0, 1.0)
SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS, st.integers(1, 12), st.integers(0, 12), st.booleans())
def test_assignment_is_as_cheap_as_that_of_scipy(seed, n_rows, more, has_ties):
    rng = np.random.default_rng(seed)
    n_columns = n_rows + more
    cost = np.zeros((24, 24))
    values = rng.integers(-3, 4, (n_rows, n_columns)) if has_ties else rng.normal(size=(n_rows, n_columns))
    cost[:n_rows, :n_columns] = values
    work = make_assign_work(24)
    assign(cost, n_rows, n_columns, work)
    columns = work.column_of[:n_rows]
    assert len(set(columns.tolist())) == n_rows
    want = values[linear_sum_assignment(values)].sum()
    assert values[np.arange(n_rows), columns].sum() == pytest.approx(want, abs=1e-12)


def test_filter_is_the_textbook_filter():
    # The oracle keeps P itself; 200 steps are too few for it to go wrong: agreement to rounding.
    rng = np.random.default_rng(4)
    x, P = np.zeros(5), np.diag([1e-2, 1e-2, 0.1, 0.1, 25.0])
    H = np.zeros((3, 5))
    H[0, 0] = H[1, 1] = H[2, 4] = 1.0
    xk, U, D, out = x.copy(), np.eye(5), np.diag(P).copy(), np.zeros((5, 5))
    W, Dw, h, gain, dx = np.zeros((5, 10)), np.zeros(10), np.zeros(5), np.zeros(5), np.zeros(5)
    for _ in range(200):
        dt = rng.exponential(0.02)
        Phi = np.eye(5)
        Phi[0, 2] = Phi[1, 3] = dt
        Q = np.zeros((5, 5))
        for (p, v), q in (((0, 2), 0.01), ((1, 3), 0.02)):
            Q[np.ix_([p, v], [p, v])] = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        Q[4, 4] = 100.0 * dt
        x, P = Phi @ x, Phi @ P @ Phi.T + Q
        kalman.predict(xk, U, D, dt, 0.01, 0.02, 100.0, W, Dw)
        root = rng.normal(size=(3, 3)) * [[1e-3], [1e-3], [0.3]]
        R = root @ root.T + np.diag([1e-8, 1e-8, 1e-4])
        y = rng.normal(size=3) * [1e-3, 1e-3, 1.0]
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x, P = x + K @ y, (np.eye(5) - K @ H) @ P @ (np.eye(5) - K @ H).T + K @ R @ K.T
        kalman.correct(xk, U, D, y, R.copy(), h, gain, dx)
        kalman.covariance(U, D, out)
        assert np.allclose(xk, x, rtol=1e-7, atol=1e-12)
        scale = np.sqrt(np.outer(np.diag(P), np.diag(P)))
        assert np.allclose(out / scale, P / scale, rtol=0, atol=1e-8)


def test_reported_covariance_is_honest_for_the_motion_it_assumes():
    # normalised error squared of (s, a, velocities): mean 4 of chi-squared; 40 runs x 20 cycles, correlated
    # in time, so the mean is known to about 10 %
    rng = np.random.default_rng(11)
    R = np.diag([1e-6, 1e-6, 0.01])
    errors = []
    for _ in range(40):
        film = Film()
        truth = np.array([0.2, 0.0, 0.0, 0.0])
        for n in range(60):
            q = 0.01 * np.array([[0.02**3 / 3, 0.02**2 / 2], [0.02**2 / 2, 0.02]])
            kick = rng.multivariate_normal(np.zeros(2), q, size=2)
            truth[:2] += 0.02 * truth[2:] + kick[:, 0]
            truth[2:] += kick[:, 1]
            z = truth[:2] + rng.normal(size=2) * 1e-3
            tracks = film.show((1, *z, 5.0 + 0.1 * rng.normal()), covariance=[R])
            if n >= 40:
                e = tracks.mean[0, :4] - truth
                errors.append(e @ np.linalg.solve(tracks.covariance[0, :4, :4], e))
    assert np.mean(errors) == pytest.approx(4.0, rel=0.25)


# --- Invariances -----------------------------------------------------------------------------------


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


# --- Long runs -------------------------------------------------------------------------------------


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
