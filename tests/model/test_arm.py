"""The compiled arm: numbering, columns, and tactels that keep their distances on any surface."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from skinbus.model import Arm, Cone, Link, Patch, PlacedPatch, Surface, grid

SURFACES = [Surface.plane(0.3, 0.3), Surface.cylinder(0.3, 0.05), Surface.cone(0.3, 0.09, 0.05)]


def one(surface, *, s=0.15, a=0.0, yaw=0.0):
    placed = PlacedPatch(patch=Patch.default(), node_id=1, link=0, s=s, a=a, yaw=yaw)
    return Arm("test", [Link("link", surface)], [placed])


@pytest.mark.parametrize("surface", SURFACES, ids=lambda s: s.kind)
@given(s=st.floats(0.05, 0.25), turn=st.floats(-0.5, 0.5), yaw=st.floats(-math.pi, math.pi))
def test_bending_a_board_stretches_nothing(surface, s, turn, yaw):
    arm = one(surface, s=s, a=turn * surface.width, yaw=yaw)
    uv = arm.patches[0].patch.tactels_uv
    flat = np.hypot(*(uv[:, None] - uv[None]).transpose(2, 0, 1))
    bent = surface.distance(arm.tactel_s[:, None], arm.tactel_a[:, None], arm.tactel_s, arm.tactel_a)
    assert_allclose(bent, flat, atol=1e-12)


@pytest.mark.parametrize("surface", SURFACES, ids=lambda s: s.kind)
@given(s=st.floats(0.05, 0.25), turn=st.floats(-0.5, 0.5), yaw=st.floats(-math.pi, math.pi))
def test_tactels_are_in_the_frame_of_their_board_where_the_board_has_them(surface, s, turn, yaw):
    arm = one(surface, s=s, a=turn * surface.width, yaw=yaw)
    uv = arm.on_board(0, arm.tactel_s, arm.tactel_a)
    assert_allclose(uv, arm.patches[0].patch.tactels_uv, atol=1e-12)


def test_u_is_along_s_and_v_along_a_unless_turned():
    straight = one(SURFACES[0])
    uv = straight.patches[0].patch.tactels_uv
    assert_allclose(straight.tactel_s - 0.15, uv[:, 0], atol=1e-15)
    assert_allclose(straight.tactel_a, uv[:, 1], atol=1e-15)
    turned = one(SURFACES[0], yaw=0.5 * math.pi)
    assert_allclose(turned.tactel_s - 0.15, -uv[:, 1], atol=1e-15)
    assert_allclose(turned.tactel_a, uv[:, 0], atol=1e-15)


@pytest.fixture
def arm():
    """An arm of two links and two unlike patches, the first patch on the second link."""
    small = Patch(tactels_uv=grid(2, 1, 0.01), threshold=500.0, release=400.0, gain=np.array([1.0, 2.0]))
    dead = Patch(tactels_uv=grid(3, 1, 0.01), healthy=np.array([True, False, True]), noise=10.0)
    placed = [
        PlacedPatch(patch=small, node_id=9, link=1, s=0.1, a=0.0),
        PlacedPatch(patch=dead, node_id=4, link=0, s=0.1, a=0.0),
    ]
    return Arm("test", [Link("lower", SURFACES[0]), Link("upper", SURFACES[1])], placed)


def test_tactels_are_numbered_patch_after_patch(arm):
    assert (arm.n_patches, arm.n_tactels) == (2, 5)
    assert list(arm.patch_start) == [0, 2, 5]
    assert list(arm.tactel_patch) == [0, 0, 1, 1, 1]
    assert list(arm.tactel_link) == [1, 1, 0, 0, 0]
    assert arm.tactels_of(1) == slice(2, 5)
    assert (arm.patch_at(9), arm.patch_at(4)) == (0, 1)


def test_facts_of_patches_are_spread_over_their_tactels(arm):
    assert list(arm.tactel_gain) == [1.0, 2.0, 1.0, 1.0, 1.0]
    assert list(arm.tactel_threshold) == [500.0, 500.0, 1000.0, 1000.0, 1000.0]
    assert list(arm.tactel_release) == [400.0, 400.0, 700.0, 700.0, 700.0]
    assert list(arm.tactel_noise) == [200.0, 200.0, 10.0, 10.0, 10.0]
    assert list(arm.tactel_healthy) == [True, True, True, False, True]
    assert list(arm.tactel_offset) == [0.0] * 5


def test_single_patch_takes_any_layout():
    uv = [[0.0, 0.0], [0.013, -0.002], [-0.004, 0.009]]
    arm = Arm.single_patch(uv, threshold=300.0, law=Cone(5e6))
    assert_allclose(np.stack([arm.tactel_s, arm.tactel_a], -1), uv)
    assert arm.patches[0].patch.law.slope == 5e6
    assert (arm.tactel_threshold == 300.0).all()
    assert arm.links[0].surface.width == pytest.approx(0.028)


def test_arm_without_links_or_patches_is_refused():
    with pytest.raises(ValueError, match="at least one"):
        Arm("empty", [], [])


def test_grid_is_centred_and_counts_along_u_first():
    assert_allclose(grid(2, 2, 0.01), [[-5e-3, -5e-3], [5e-3, -5e-3], [-5e-3, 5e-3], [5e-3, 5e-3]])
    assert_allclose(grid(7, 3, 0.01).mean(axis=0), 0.0, atol=1e-17)
    assert Patch.default().n_tactels == 16
