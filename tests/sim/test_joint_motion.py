"""Joints that move in a scene: positions, touches that stay in the base, and what is refused."""

import math

import numpy as np
import pytest

import skinbus
from skinbus.config.system import load_arm
from skinbus.errors import ConfigError
from skinbus.robot import RobotFrames
from skinbus.sim import load_scene
from tests.robot.two_joints import ARM, SCENE, write

pytest.importorskip("yourdfpy", reason="extra skinbus[robot]")

CYLINDER = ARM.replace(
    'surface = "plane"\nlength_mm = 50.0\nwidth_mm = 50.0',
    'surface = "cylinder"\nlength_mm = 80\nradius_mm = 60',
)
CONE = ARM.replace(
    'surface = "plane"\nlength_mm = 50.0\nwidth_mm = 50.0',
    'surface = "cone"\nlength_mm = 80\nradius_near_mm = 70\nradius_far_mm = 60',
)
MOVES = """
[[joint]]
name = "first"
path = [[0.2, 10.0], [0.8, 40.0], [1.0, 40.0]]
"""
ROLLS = MOVES.replace("first", "second")
FIXED_IN_BASE = SCENE.replace("force_n = 8.0", 'force_n = 8.0\nfixed_in = "base"').replace("9.0", "1.5")


def free(arm):
    """The arm file without a fixed second joint."""
    return arm.replace("fixed_deg = 30", "sd_deg = 0.001")


def scene_of(folder, arm, text):
    write(folder, arm)
    (folder / "scene.toml").write_text(text)
    return load_scene(folder / "scene.toml")


def test_positions_are_linear_between_keys_and_stay_beyond_them(tmp_path):
    motion = scene_of(tmp_path, ARM, SCENE + MOVES).motion
    assert motion.names == ("first", "second")
    for t_s, degrees in ((0.0, 10.0), (0.5, 25.0), (0.9, 40.0), (7.0, 40.0)):
        np.testing.assert_allclose(motion.positions(t_s), np.radians([degrees, 30.0]))


TIMES = (0.31, 0.4, 0.5003, 0.77, 1.2)


@pytest.mark.parametrize("arm", [ARM, CYLINDER, CONE], ids=["plane", "cylinder", "cone"])
def test_a_touch_in_the_base_presses_where_the_surface_is_nearest(tmp_path, arm):
    is_flat = arm is ARM
    text = FIXED_IN_BASE if is_flat else FIXED_IN_BASE.replace("a_mm = 3.0", "angle_deg = 170.0")
    moves = (MOVES + ROLLS).replace("40.0", "14.0")
    scene = scene_of(tmp_path, free(arm), text + moves)
    arm = load_arm(tmp_path / "arm.toml")
    surface, frames = arm.links[0].surface, RobotFrames(arm)
    X_BS = frames.surface_poses(scene.motion.positions([0.3, *TIMES]))[:, 0]
    R, p = X_BS[0, :3, :3], X_BS[0, :3, 3]
    point = R @ surface.position(0.027, 0.003 if is_flat else math.radians(170) * surface.radius)[0] + p
    across = np.linspace(-0.1, 0.1, 801) if is_flat else np.linspace(-0.5, 0.5, 801) * surface.width
    s, a = (x.ravel() for x in np.meshgrid(np.linspace(-0.1, 0.2, 601), across))
    for t_s, X in zip(TIMES, X_BS[1:], strict=True):
        touch = scene.touches_at(t_s)
        here = X[:3, :3].T @ (point - X[:3, 3])
        apart = np.linalg.norm(surface.position(s, a)[0] - here, axis=1)
        nearest = np.argmin(apart)
        assert surface.distance(touch.s, touch.a, s[nearest], a[nearest])[0] < 1e-3  # of the grid
        assert np.linalg.norm(surface.position(touch.s[0], touch.a[0])[0] - here) <= apart[nearest] + 1e-6
        assert touch.force[0] == pytest.approx(8.0 * min((t_s - 0.3) / 0.1, 1.0))


@pytest.mark.slow
def test_the_robot_is_where_the_scene_moves_it(tmp_path):
    write(tmp_path, ARM)
    (tmp_path / "scene.toml").write_text(FIXED_IN_BASE + MOVES)
    errors = []
    with skinbus.simulate(str(tmp_path / "scene.toml")) as skin:
        motion = load_scene(tmp_path / "scene.toml").motion
        first_ns = None
        for cycle in skin:
            first_ns = first_ns or cycle.t_ns - round(1e9 * skin.period_s)
            if cycle.t_ns > 1.4e9:
                break
            if cycle.robot_valid:
                errors.append(cycle.joint_positions - motion.positions(1e-9 * (cycle.t_ns - first_ns)))
    assert len(errors) > 30
    # samples count from the first SYNC, and scene time is that of a sample: within a period of 0.87 rad/s
    assert np.abs(errors).max() < 0.87 * 0.0101


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            SCENE + MOVES.replace("first", "third"),
            "joint 1.name: is 'third'; wanted a joint of the robot: first, second",
        ),
        (SCENE + MOVES.replace("0.8", "0.2"), "wanted times that grow"),
        (SCENE + MOVES + MOVES, "joint 2.name: is 'first'; wanted a joint without a path"),
        (SCENE + ROLLS, "wanted a joint that the arm file does not fix"),
        (SCENE + MOVES.replace("40.0]]", "400.0]]"), "within the URDF's limits, -171.887 to 171.887"),
        (
            FIXED_IN_BASE,
            "touch 1.fixed_in: is 'base'; wanted [robot] in the arm file and [[joint]] in the scene",
        ),
        (SCENE.replace('"arm.toml"', '"pad"') + MOVES, "no such table: pad has no [robot]"),
        (SCENE + "[[joint]]\nname = 3", "joint 1"),
        ("joint = 3\n" + SCENE, "wanted an array of tables, [[joint]]"),
    ],
)
def test_faults_of_motions_are_reported(tmp_path, text, said):
    write(tmp_path, ARM)
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(ConfigError) as refused:
        load_scene(tmp_path / "scene.toml")
    assert said in str(refused.value)
