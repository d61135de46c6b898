"""Edges and palms: the integral of the layer's solution over their pressure, within 1.5e-3 of the peak."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface, grid
from skinbus.sim.bonded_layer import profile
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.laws import Elastic
from skinbus.sim.layer import Geometry, Loads
from tests.marks import slow

EDGE = Indenter(Shape.EDGE, 0.06)
PALM = Indenter(Shape.PALM, 0.05, 0.03)
BOUND = 1.5e-3


def board(pitch=6.25e-3, n=8):
    patch = Patch(tactels_uv=grid(n, n, pitch), size=(0.06, 0.06))
    surface = Surface.plane(0.06, 0.06)
    placed = PlacedPatch(patch=patch, node_id=1, link=0, s=0.03, a=0.0)
    return Arm("board", [Link("board", surface)], [placed])


def pressures(arm, indenter, place, *, thickness_mm, tactel, force=10.0):
    geometry = Geometry.of(arm, discs=tactel == "disc")
    law = Elastic(thickness_mm=thickness_mm).bind(geometry, [indenter])
    s, a, yaw = place
    out = np.zeros(arm.n_tactels)
    law.add(Loads(1, s=s, a=a, yaw=yaw, force=force), out)
    return out


def middles(n):
    """The middles of n parts of 0 to 1."""
    return (np.arange(n) + 0.5) / n


def integrated(arm, indenter, place, *, thickness_mm, tactel, force=10.0):
    """The same by the middles of small parts of the shape, places as complex numbers: the oracle."""
    thickness = 1e-3 * thickness_mm
    radius = 0.5 * arm.patches[0].patch.diameter if tactel == "disc" else 0.0
    solved = np.arange(0.0, 14.0 * thickness + radius, 0.05 * thickness)
    k = CubicSpline(solved, profile(solved, thickness=thickness, poisson=0.48, tactel_radius=radius))
    if indenter.shape is Shape.EDGE:
        parts = indenter.length * (middles(2000) - 0.5)
        share = np.ones(2000)
    else:  # the paraboloid over the ellipse
        r, angle = np.meshgrid(middles(180), 2.0 * np.pi * middles(240))
        parts = 0.5 * (r * (indenter.length * np.cos(angle) + 1j * indenter.width * np.sin(angle))).ravel()
        share = (r * (1.0 - r * r)).ravel()
    share = share / share.sum()
    s, a, yaw = place
    away = np.abs((arm.tactel_s + 1j * arm.tactel_a)[:, None] - (s + 1j * a + np.exp(1j * yaw) * parts))
    return force * np.where(away < solved[-1], k(np.minimum(away, solved[-1])), 0.0) @ share


@pytest.mark.parametrize("indenter", [EDGE, PALM], ids=["edge", "palm"])
@pytest.mark.parametrize("tactel", ["point", "disc"])
@pytest.mark.parametrize("thickness_mm", [6.0, *slow(1.0, 2.0, 20.0)])
def test_pressures_are_the_integral_over_the_shape_within_the_bound(indenter, tactel, thickness_mm):
    arm = board()
    for place in ((0.031, 0.002, 0.4), (0.02, -0.013, 1.3)):
        how = {"thickness_mm": thickness_mm, "tactel": tactel}
        given = pressures(arm, indenter, place, **how)
        expected = integrated(arm, indenter, place, **how)
        assert np.abs(given - expected).max() <= BOUND * expected.max()
