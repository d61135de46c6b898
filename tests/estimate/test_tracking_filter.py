"""The filter and the assignment of tracks against textbook and SciPy, invariances, and long runs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbus.estimate.tracking import Tracker
from tests.estimate.track_rig import ARM, PERIOD_NS, SURFACES, Film, contacts

SEEDS = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("age_ms", [0, 45])
def test_filter_is_the_textbook_filter(age_ms):
    """Of place, velocity and force on a plane, where s, a and force are independent."""
    rng = np.random.default_rng(4)
    film, H = Film(), np.zeros((3, 5))
    H[0, 0] = H[1, 1] = H[2, 4] = 1.0
    H[0, 2] = H[1, 3] = -1e-3 * age_ms
    x, P = np.zeros(5), np.zeros((5, 5))
    for n in range(200):
        dt_ns = int(rng.integers(1_000_000, 40_000_000))
        R = np.diag([1e-3, 2e-3, 0.3]) ** 2
        z = np.array([0.2, 0.0, 5.0]) + 0.5 * rng.normal(size=3) * [1e-3, 2e-3, 0.3]
        tracks = film.show((1, *z), after_ns=dt_ns, age_ns=1_000_000 * age_ms, covariance=[R])
        assert tracks.t_ns - tracks.seen_ns == 1_000_000 * age_ms
        if n == 0:
            x[[0, 1, 4]], P[:] = z, np.diag([R[0, 0], R[1, 1], 0.7**2, 0.7**2, R[2, 2]])
        else:
            dt = 1e-9 * dt_ns
            Phi, Q = np.eye(5), np.zeros((5, 5))
            Phi[0, 2] = Phi[1, 3] = dt
            for p, v in ((0, 2), (1, 3)):
                Q[np.ix_([p, v], [p, v])] = 0.01 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
            Q[4, 4] = 100.0 * dt
            x, P = Phi @ x, Phi @ P @ Phi.T + Q
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            x, P = x + K @ (z - H @ x), (np.eye(5) - K @ H) @ P @ (np.eye(5) - K @ H).T + K @ R @ K.T
        assert np.allclose(tracks.mean[0], x, rtol=1e-7, atol=1e-9)
        place, speed = [0, 1], [2, 3]
        wanted = np.stack([P[place, place], P[place, speed], P[speed, speed]], -1)
        np.testing.assert_allclose(tracks.covariance[0, :2], wanted, rtol=1e-6, atol=1e-12)
        assert tracks.covariance[0, 2, 0] == pytest.approx(P[4, 4])


def play(rng_seed, order=None):
    """Run three wandering contacts on the cylinder; return the columns that must not change."""
    rng = np.random.default_rng(rng_seed)
    tracker = Tracker(ARM)
    place = rng.uniform([0.05, -0.15, 1.0], [0.35, 0.15, 9.0], (3, 3))
    out = []
    for n in range(12):
        place[:, :2] += rng.normal(size=(3, 2)) * 3e-3
        seen = rng.random(3) < 0.9
        rows = [(0, s, float(SURFACES[0].wrap(a)), f) for s, a, f in place[seen]]
        if order is not None:
            rows = [rows[i] for i in np.random.default_rng(order + n).permutation(len(rows))]
        t = tracker.update(contacts(*rows), n * PERIOD_NS)
        out.append((t.identity, t.id, t.slot, t.state, t.mean, t.covariance))
    return out


@given(SEEDS, SEEDS)
def test_order_of_contacts_changes_no_bit(seed, order):
    for a, b in zip(play(seed), play(seed, order=order), strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
