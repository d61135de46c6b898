"""Distances on a chart with a scale that changes, against a ball in stereographic projection."""

import numpy as np
import pytest

from skinbus.model.bend import MOST, bend_at, bend_of, bent

R = 0.08


def metric(z):
    """phi of the projection of a ball, its gradient and second derivatives at z (2,) m."""
    w = 1.0 + z @ z / (4.0 * R * R)
    slope = -z / (2.0 * R * R)
    return -np.log(w), slope / w, -np.eye(2) / (2.0 * R * R * w) + np.outer(slope, slope) / w**2


def on_ball(z):
    """Where z (2,) is on the ball, a unit vector."""
    x, y = z / (2.0 * R)
    return np.array([2.0 * x, 2.0 * y, 1.0 - x * x - y * y]) / (1.0 + x * x + y * y)


def worst_part(reach):
    """Return the largest error of distances of about this length (m), as a part of them."""
    rng, worst = np.random.default_rng(91), 0.0
    for _ in range(300):
        here = rng.uniform(-0.04, 0.04, 2)
        phi, gradient, second = metric(here)
        angle = rng.uniform(0.0, 2.0 * np.pi)
        off = np.exp(-phi) * reach * np.array([np.cos(angle), np.sin(angle)])
        true = R * np.arccos(on_ball(here) @ on_ball(here + off))
        found = np.exp(phi) * np.linalg.norm(off) * bent(bend_of(gradient, second), *off)
        worst = max(worst, abs(found / true - 1.0))
    return worst


def test_distances_are_those_on_a_ball_and_what_is_left_out_falls_with_their_cube():
    assert 20.0 * worst_part(0.02) < 0.1  # mm
    assert worst_part(0.04) < 0.01
    assert worst_part(0.02) < worst_part(0.04) / 6.0
    assert worst_part(0.01) < worst_part(0.02) / 6.0


def test_kernels_and_tables_agree_and_derivatives_are_those_of_the_value():
    rng = np.random.default_rng(92)
    bends = rng.normal(0.0, [2.0, 2.0, 30.0, 30.0, 30.0], (300, 5))
    places = rng.uniform(-0.2, 0.2, (300, 2))
    h = 1e-6
    for i, (x, y) in enumerate(places):
        value, by_x, by_y = bend_at.py_func(bends, i, x, y)
        assert value == pytest.approx(float(bent(bends[i], x, y)))
        assert 1.0 / MOST <= value <= MOST
        steps = [
            (bend_at.py_func(bends, i, x + dx, y + dy)[0] - bend_at.py_func(bends, i, x - dx, y - dy)[0])
            for dx, dy in ((h, 0.0), (0.0, h))
        ]
        assert (by_x, by_y) == pytest.approx([step / (2.0 * h) for step in steps], abs=1e-3)
