"""Arm files with meshes: boards laid by point and direction; every fault at once."""

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.model import Surface, grid
from tests.files import faults_of
from tests.robot.mesh_arms import TUBE_ARM as ARM
from tests.robot.mesh_arms import write_tube as write
from tests.run_in_process import run_code

pytest.importorskip("potpourri3d", reason="extra skinbus[mesh]")

CYLINDRIC = 'surface = "cylinder"\nradius_mm = 40\nlength_mm = 140'
CYLINDER = Surface.cylinder(0.14, 0.04)


def test_boards_lie_where_the_file_says_whatever_the_unit_of_the_mesh(tmp_path):
    path = write(tmp_path, ARM)
    arm = load_arm(path)
    surface = arm.links[0].surface
    point, _ = surface.position(arm.tactel_s, arm.tactel_a)
    for p, (turn, yaw) in enumerate(((0.0, 0.0), (0.25, -np.pi / 2))):
        u, v = grid(4, 4, 0.01).T
        s, a = 0.07 + np.cos(yaw) * u - np.sin(yaw) * v, np.sin(yaw) * u + np.cos(yaw) * v
        wanted, _ = CYLINDER.position(s, a + turn * CYLINDER.period)
        assert np.linalg.norm(point[arm.tactels_of(p)] - wanted, axis=1).max() < 0.1e-3


def test_every_fault_of_boards_is_said_at_once(tmp_path):
    text = ARM.replace("xyz_mm = [70.0, 40.0, 0.0]", "xyz_mm = [70.0, 0.0, 90.0]")
    (told,) = faults_of(load_arm, write(tmp_path, text))
    assert told.startswith("patch[2].xyz_mm")
    assert "50.0 mm away" in told


def test_keys_that_do_not_go_together_are_refused(tmp_path):
    told = faults_of(load_arm, write(tmp_path, ARM.replace('mesh = "tube.stl"', "radius_mm = 5")))
    assert [line.partition(":")[0] for line in told] == ["link[1].mesh", "link[1].radius_mm"]
    told = faults_of(
        load_arm, write(tmp_path, ARM.replace("along = [0.0, 0.0, 1.0]", "s_mm = 3\nyaw_deg = 4"))
    )
    assert [line.partition(":")[0] for line in told] == ["patch[2].s_mm", "patch[2].yaw_deg"]
    flat = ARM.replace('surface = "mesh"\nmesh = "tube.stl"\nunit_mm = 10', CYLINDRIC)
    told = faults_of(load_arm, write(tmp_path, flat))
    for key in ("patch[1].s_mm", "patch[1].xyz_mm", "patch[2].along"):
        assert any(line.startswith(key) for line in told), key


def test_a_mesh_that_cannot_be_used_is_a_fault_of_the_arm_file(tmp_path):
    path = write(tmp_path, ARM)
    (tmp_path / "tube.stl").write_bytes(b"solid nothing")
    (told,) = faults_of(load_arm, path)
    assert told.startswith("link[1].mesh")
    assert "tube.stl" in told
    (tmp_path / "tube.stl").unlink()
    (told,) = faults_of(load_arm, path)
    assert "No such file" in told


@pytest.mark.slow
def test_an_arm_without_a_mesh_loads_nothing_of_meshes():
    code = (
        "import sys; from skinbus.config.system import load_arm; load_arm('forearm');"
        "print([m for m in sys.modules if m.startswith(('skinbus.robot', 'trimesh', 'potpourri3d'))])"
    )
    assert run_code(code) == "[]"
