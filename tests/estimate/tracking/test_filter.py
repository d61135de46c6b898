"""The filter of one track: the textbook filter, and a covariance that holds for the motion it assumes."""

import numpy as np
import pytest

from skinbus.estimate.tracking import filter as kalman
from tests.estimate.tracking.track_rig import Film
from tests.inner_kernels import from_python

predict, correct = from_python(kalman.predict), from_python(kalman.correct)
covariance = from_python(kalman.covariance)


@pytest.mark.slow
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
        predict(xk, U, D, dt, 0.01, 0.02, 100.0, W, Dw)
        root = rng.normal(size=(3, 3)) * [[1e-3], [1e-3], [0.3]]
        R = root @ root.T + np.diag([1e-8, 1e-8, 1e-4])
        y = rng.normal(size=3) * [1e-3, 1e-3, 1.0]
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x, P = x + K @ y, (np.eye(5) - K @ H) @ P @ (np.eye(5) - K @ H).T + K @ R @ K.T
        correct(xk, U, D, y, R.copy(), h, gain, dx)
        covariance(U, D, out)
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
