"""Boards side by side: overlap and overhang against sampled boards."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbus.config.mounting import outside, overlap
from skinbus.model import Patch, PlacedPatch, Surface

PATCH = Patch.default()
SURFACES = [Surface.plane(0.3, 0.4), Surface.cylinder(0.3, 0.06), Surface.cone(0.3, 0.08, 0.05)]


def place(s, a, yaw=0.0):
    return PlacedPatch(patch=PATCH, node_id=1, link=0, s=s, a=a, yaw=yaw)


def samples(surface, placed, n=21):
    """Return chart points all over a board, its rim included."""
    u = np.linspace(-0.025, 0.025, n)
    u, v = (g.ravel() for g in np.meshgrid(u, u))
    cos, sin = math.cos(placed.yaw), math.sin(placed.yaw)
    return surface.undevelop(placed.s + cos * u - sin * v, sin * u + cos * v, placed.a)


def inside(surface, placed, s, a):
    """Return how deep chart points lie inside a board, m; negative outside."""
    x, y = surface.develop(s, a, placed.a)
    cos, sin = math.cos(placed.yaw), math.sin(placed.yaw)
    u, v = cos * (x - placed.s) + sin * y, -sin * (x - placed.s) + cos * y
    return 0.025 - np.maximum(abs(u), abs(v))


@pytest.mark.parametrize("surface", SURFACES, ids=lambda s: s.kind)
@given(
    ds=st.floats(-0.1, 0.1),
    turn=st.floats(-0.5, 0.5),
    yaw1=st.floats(-1.6, 1.6),
    yaw2=st.floats(-1.6, 1.6),
)
def test_overlap_agrees_with_sampled_boards(surface, ds, turn, yaw1, yaw2):
    first, second = place(0.15, 0.1, yaw1), place(0.15 + ds, 0.1 + turn * surface.width, yaw2)
    depth = overlap(surface, first, second)
    deepest = float(inside(surface, first, *samples(surface, second)).max())
    spacing = 0.05 / 20
    if depth < 0.0:
        assert deepest < 1e-12
    elif depth > 2 * spacing:
        assert deepest > 0.0


@pytest.mark.parametrize("surface", SURFACES, ids=lambda s: s.kind)
def test_boards_side_by_side_touch(surface):
    assert overlap(surface, place(0.1, 0.0), place(0.15, 0.0)) == pytest.approx(0.0, abs=1e-12)
    assert overlap(surface, place(0.1, 0.0), place(0.148, 0.0)) == pytest.approx(2e-3, abs=1e-12)
    assert overlap(surface, place(0.1, 0.0), place(0.151, 0.0)) == pytest.approx(-1e-3, abs=1e-12)


def test_triangles_may_stand_between_triangles():
    corners = 0.01 * np.array([(-1.0, -1.0), (1.0, -1.0), (0.0, 1.0)])
    board = Patch(tactels_uv=corners, size=(0.022, 0.022))  # 1 mm around its tactels
    surface = Surface.plane(0.3, 0.3)

    def depth(apart):
        first, second = (
            PlacedPatch(patch=board, node_id=1, link=0, s=s, a=0.0, yaw=yaw)
            for s, yaw in ((0.1, 0.0), (0.1 + apart, math.pi))
        )
        return overlap(surface, first, second)

    # their slanted sides, of slope 2, meet at 10 mm without the margins
    gap = (2.0 * (0.014 - 0.010) - 2.0 * (2.0 + 1.0) * 1e-3) / math.sqrt(5.0)
    assert depth(0.014) == pytest.approx(-gap, abs=0.3e-3)
    assert depth(0.009) > 1e-3


def test_overlap_is_seen_across_the_wrap():
    tube = SURFACES[1]
    half = 0.5 * tube.period
    assert overlap(tube, place(0.1, half - 0.024), place(0.1, -half + 0.024)) == pytest.approx(2e-3)


@pytest.mark.parametrize("surface", SURFACES, ids=lambda s: s.kind)
def test_overhang_is_measured_at_both_ends(surface):
    assert outside(surface, place(0.15, 0.0)) <= 0.0
    assert 5e-3 - 1e-12 <= outside(surface, place(0.02, 0.0)) <= 5.5e-3  # see the next test
    assert outside(surface, place(0.28, 0.0)) == pytest.approx(5e-3, abs=1e-12)


def test_board_that_reaches_beyond_the_apex_of_a_cone_is_outside():
    horn = Surface.cone(0.2, 0.06, 0.001)
    assert outside(horn, place(0.19, 0.0)) > 1e-3


def test_overhang_at_the_sides_of_a_plane():
    assert outside(SURFACES[0], place(0.15, 0.18)) == pytest.approx(5e-3)
    assert outside(SURFACES[0], place(0.15, -0.18)) == pytest.approx(5e-3)
