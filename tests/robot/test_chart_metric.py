"""Distances on charts whose metric is known: a ball in stereographic projection, a cone, a plane."""

import numpy as np
import pytest

from skinbus.model.bend import bent
from skinbus.robot.chart_metric import ChartMetric
from skinbus.robot.flattening import Flattening
from tests.robot.meshes import wrapped

R = 0.08


def chart_of(scale_at, half=0.09, edge=3e-3, period=0.0):
    """A square chart (or a closed one) of a grid of corners, with this scale at places (n, 2) m."""
    n = int(2.0 * half / edge) + 1
    m = round(period / edge) if period else n
    s = np.linspace(-half, half, n)
    a = np.arange(m) * period / m if period else s
    places = np.stack(np.meshgrid(s, a, indexing="ij"), -1).reshape(-1, 2)
    triangles = wrapped(n, m, False)
    triangles = triangles if period else triangles[(np.ptp(triangles % m, axis=1) < m - 1)]
    corners = places[triangles]
    if period:  # a triangle is where its middle is
        corners[..., 1] += period * np.round((corners[:, :1, 1] - corners[..., 1]) / period)
    points = np.concatenate([places, np.zeros((len(places), 1))], axis=1)
    return Flattening(points, triangles, corners, scale_at(places), period)


def scale_of_ball(z):
    return 1.0 + (z * z).sum(-1) / (4.0 * R * R)


def on_ball(z):
    """Where z (..., 2) is on the ball, a unit vector."""
    x, y = np.moveaxis(np.asarray(z) / (2.0 * R), -1, 0)
    return np.stack([2.0 * x, 2.0 * y, 1.0 - x * x - y * y], -1) / (1.0 + x * x + y * y)[..., None]


def test_distances_are_those_on_a_ball_within_reach():
    chart, rng = chart_of(scale_of_ball), np.random.default_rng(91)
    here = rng.uniform(-0.04, 0.04, (40, 2))
    rows = ChartMetric(chart).around(here)
    assert rows[:, :2] == pytest.approx(here)
    assert rows[:, 2] == pytest.approx(scale_of_ball(here), rel=5e-4)
    angle = rng.uniform(0.0, 2.0 * np.pi, (30, 40))
    for reach, error in ((0.01, 0.02e-3), (0.02, 0.05e-3), (0.03, 0.05e-3), (0.04, 0.1e-3)):
        off = (reach * rows[:, 2] * np.stack([np.cos(angle), np.sin(angle)])).transpose(1, 2, 0)
        true = R * np.arccos((on_ball(here) * on_ball(here + off)).sum(-1))
        found = np.linalg.norm(off, axis=-1) / rows[:, 2] * bent(rows[:, 3:], off[..., 0], off[..., 1])
        assert np.abs(found - true).max() < error, reach


def test_distances_are_those_on_a_cone_that_is_closed():
    """Around a cone the chart that closes has the scale exp(-k s); the cone unrolled is exp(k z) / k."""
    k, period = 3.0, 0.24
    chart = chart_of(lambda z: np.exp(-k * z[:, 0]), period=period)
    rng = np.random.default_rng(93)
    here = np.stack([rng.uniform(-0.05, 0.05, 20), rng.uniform(-0.12, 0.12, 20)], -1)
    rows = ChartMetric(chart).around(here)
    angle = rng.uniform(0.0, 2.0 * np.pi, (30, 20))
    off = (0.04 * rows[:, 2] * np.stack([np.cos(angle), np.sin(angle)])).transpose(1, 2, 0)

    def unrolled(z):
        return np.exp(k * (z[..., 0] + 1j * z[..., 1])) / k

    true = np.abs(unrolled(here + off) - unrolled(here))
    found = np.linalg.norm(off, axis=-1) / rows[:, 2] * bent(rows[:, 3:], off[..., 0], off[..., 1])
    assert np.abs(found / true - 1.0).max() < 1e-3


def test_what_can_be_unrolled_needs_no_correction_and_beside_a_rim_nothing_is_made_up():
    flat = ChartMetric(chart_of(lambda z: np.ones(len(z)))).around(np.zeros((1, 2)))
    assert flat[0, 2] == 1.0
    assert not flat[0, 3:].any()
    place = np.array([[0.09, 0.09]])  # the corner of the chart: a quarter of the disc is there
    row = ChartMetric(chart_of(scale_of_ball)).around(place)[0]
    assert row[2] == pytest.approx(scale_of_ball(place[0]), rel=5e-3)
    inward = -0.03 * row[2] * np.array([np.cos(0.7), np.sin(0.7)])
    true = R * np.arccos(on_ball(place[0]) @ on_ball(place[0] + inward))
    assert 0.03 * bent(row[3:], *inward) == pytest.approx(true, rel=5e-3)
