"""Meshes lie on the surfaces that they are meshes of, and look outward."""

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.model import Surface
from skinbus.view.web.solids import (
    OVER,
    UNDER,
    board_cross,
    board_meshes,
    board_outline,
    link_mesh,
    quaternions,
    tactel_discs,
    unit_disc,
)


def outward(mesh, from_point):
    """Return the share of the area of a mesh whose faces look away from a point."""
    corners = mesh.vertices.astype(float)[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    away = np.einsum("ij,ij->i", normals, corners.mean(1) - from_point) > 0.0
    areas = np.linalg.norm(normals, axis=1)
    return areas[away].sum() / areas.sum()


@pytest.mark.parametrize(
    "surface",
    [Surface.plane(0.1, 0.06), Surface.cylinder(0.15, 0.05), Surface.cone(0.1, 0.06, 0.04)],
    ids=lambda surface: surface.kind,
)
def test_link_is_closed_looks_outward_and_lies_just_under_its_surface(surface):
    mesh = link_mesh(surface)
    edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()
    assert outward(mesh, mesh.vertices.mean(0)) == pytest.approx(1.0)
    if surface.period:
        s = surface.length * np.array([0.0, 1.0])
        radii = np.linalg.norm(mesh.vertices[:-2, 1:], axis=1)
        wanted = surface.radius_at(s) - UNDER * np.sqrt(1.0 - surface.taper**2)
        assert np.unique(radii.round(6)) == pytest.approx(np.unique(wanted.round(6)), abs=2e-6)


@pytest.mark.parametrize("name", ["pad", "forearm", "arm"])
def test_boards_and_tactels_lie_on_their_links(name):
    arm = load_arm(name)
    n = 0
    for k, link in enumerate(arm.links):
        boards, discs = board_meshes(arm, k), tactel_discs(arm, k)
        n += len(discs.radius)
        here = arm.tactel_link == k
        points, normals = link.surface.position(arm.tactel_s[here], arm.tactel_a[here])
        assert discs.centre == pytest.approx(points + OVER * normals, abs=1e-6)
        assert 2.0 * discs.radius == pytest.approx(9.53e-3)
        inside = [0.05, 0.0, -1.0] if link.surface.kind == "plane" else [0.5 * link.surface.length, 0.0, 0.0]
        assert outward(boards, np.array(inside)) == pytest.approx(1.0)
        if link.surface.period:
            radius = link.surface.radius_at(boards.vertices[:, 0] / np.sqrt(1.0 - link.surface.taper**2))
            assert np.linalg.norm(boards.vertices[:, 1:], axis=1) == pytest.approx(radius, abs=1e-5)
    assert n == arm.n_tactels


def test_outline_and_cross_of_a_board_are_on_it():
    arm = load_arm("forearm")
    for p in (0, 4, 23):
        centre, _ = arm.links[0].surface.position(arm.patch_s[p], arm.patch_a[p])
        outline, cross = board_outline(arm, p), board_cross(arm, p)
        far = np.linalg.norm(outline - centre, axis=-1)
        assert 0.023 < far.min() < far.max() < 0.037
        assert np.linalg.norm(cross - centre, axis=-1).min() < 0.003


def test_discs_face_along_the_normals():
    rng = np.random.default_rng(5)
    normals = rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[0], normals[1] = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
    for (w, x, y, z), normal in zip(quaternions(normals).astype(float), normals, strict=True):
        turned = [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)]
        assert turned == pytest.approx(normal, abs=1e-6)
    for n in (4, 16):
        disc = unit_disc(n)
        assert outward(disc, np.array([0.0, 0.0, -1.0])) == pytest.approx(1.0)
        a, b, c = (disc.vertices[disc.faces[:, k]] for k in range(3))
        assert 0.5 * np.cross(b - a, c - a)[:, 2].sum() == pytest.approx(np.pi, rel=1e-6)
