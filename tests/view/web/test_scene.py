"""Meshes lie on the surfaces that they are meshes of, and look outward; memory stays as it is."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skinbus.config.system import load_arm
from skinbus.model import Surface
from skinbus.view.web.page import Server
from skinbus.view.web.poses import Poses
from skinbus.view.web.scene import UNDER, SceneNodes, board_meshes, link_mesh, quaternions
from tests.files import put
from tests.robot.two_joints import FROM_PYTHON, URDF, write

trimesh = pytest.importorskip("trimesh", reason="extra skinbus[mesh]")


@pytest.mark.parametrize(
    "surface",
    [Surface.plane(0.1, 0.06), Surface.cylinder(0.15, 0.05), Surface.cone(0.1, 0.06, 0.04)],
    ids=lambda surface: surface.kind,
)
def test_link_is_closed_looks_outward_and_lies_just_under_its_surface(surface):
    mesh = link_mesh(surface)
    solid = trimesh.Trimesh(*mesh)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.volume > 0.0, "it looks outward"
    if surface.period:
        s = surface.length * np.array([0.0, 1.0])
        radii = np.linalg.norm(mesh[0][:, 1:], axis=1)
        wanted = surface.radius_at(s) - UNDER * np.sqrt(1.0 - surface.taper**2)
        assert np.unique(radii.round(6)) == pytest.approx(np.unique(wanted.round(6)), abs=2e-6)


@pytest.mark.parametrize("name", ["pad", "forearm", "arm"])
def test_boards_lie_on_their_links(name):
    arm = load_arm(name)
    for k, link in enumerate(arm.links):
        boards = board_meshes(arm, k)
        sheet = trimesh.Trimesh(*boards)
        _, normals = link.surface.position(*link.surface.project(sheet.triangles_center)[:2])
        assert ((sheet.face_normals * normals).sum(axis=1) > 0.9).all(), "it looks outward"
        for p in np.flatnonzero(arm.patch_link == k):
            centre, _ = link.surface.position(arm.patch_s[p], arm.patch_a[p])
            assert np.linalg.norm(boards[0] - centre, axis=1).min() < 1e-4
        if link.surface.period:
            radius = link.surface.radius_at(boards[0][:, 0] / np.sqrt(1.0 - link.surface.taper**2))
            assert np.linalg.norm(boards[0][:, 1:], axis=1) == pytest.approx(radius, abs=1e-5)


def test_discs_face_along_the_normals():
    rng = np.random.default_rng(5)
    normals = rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[0], normals[1] = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
    turned = Rotation.from_quat(quaternions(normals), scalar_first=True).apply([0.0, 0.0, 1.0])
    assert turned == pytest.approx(normals, abs=1e-6)


SHAPE = '<link name="plate"><visual><geometry><mesh filename="package://none/plate.stl"/></geometry></visual></link>'


def test_robot_without_its_shapes_is_drawn_as_lines_and_that_is_said(tmp_path):
    pytest.importorskip("yourdfpy", reason="extra skinbus[robot]")
    arm = load_arm(write(tmp_path, FROM_PYTHON) / "arm.toml")
    put(tmp_path, "two.urdf", URDF.replace('<link name="plate"/>', SHAPE))
    poses, server = Poses(arm), Server("127.0.0.1", 0)
    try:
        scene = SceneNodes(server, arm, poses)
        assert scene.note == "1 of 1 shapes of the URDF are not found: the robot is drawn as lines there"
        poses.move(np.array([1.5, -1.0]))
        scene.move()
        put(tmp_path, "two.urdf", "<robot")
        assert SceneNodes(server, arm, poses).note == "the robot is drawn as lines: KeyError: 'name'"
    finally:
        server.stop()
