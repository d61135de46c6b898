"""Joints that move in a scene: positions, and what is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skinbus.sim import load_scene
from tests.files import faults_of, put
from tests.robot.two_joints import ARM, SCENE, write

pytest.importorskip("yourdfpy", reason="extra skinbus[robot]")

MOVES = """
[[joint]]
name = "first"
path = [[0.2, 10.0], [0.8, 40.0], [1.0, 40.0]]
"""
ROLLS = MOVES.replace("first", "second")


def scene_of(folder, arm, text):
    write(folder, arm)
    return load_scene(put(folder, "scene.toml", text))


def test_positions_are_linear_between_keys_and_stay_beyond_them(tmp_path):
    motion = scene_of(tmp_path, ARM, SCENE + MOVES).motion
    assert motion.names == ("first", "second")
    for t_s, degrees in ((0.0, 10.0), (0.5, 25.0), (0.9, 40.0), (7.0, 40.0)):
        assert_allclose(motion.positions(t_s), np.radians([degrees, 30.0]))


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
        (SCENE.replace('"arm.toml"', '"pad"') + MOVES, "no such table: pad has no [robot]"),
        (SCENE + "[[joint]]\nname = 3", "joint 1"),
        ("joint = 3\n" + SCENE, "wanted an array of tables, [[joint]]"),
    ],
)
def test_faults_of_motions_are_reported(tmp_path, text, said):
    write(tmp_path, ARM)
    faults = faults_of(load_scene, put(tmp_path, "scene.toml", text))
    assert any(said in fault for fault in faults), faults
