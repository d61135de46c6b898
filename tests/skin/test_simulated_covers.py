"""The covers of a UR10e, end to end: contacts in the base frame while joints move at 1 rad/s."""

from pathlib import Path

import numpy as np
import pytest

import skinbus
from skinbus.robot import RobotFrames
from skinbus.sim import load_scene
from tests.files import put

pytest.importorskip("yourdfpy", reason="extra skinbus[robot]")
pytest.importorskip("potpourri3d", reason="extra skinbus[mesh]")

pytestmark = (
    pytest.mark.slow
)  # 24 boards from scene to master; frames and meshes have quick tests of their own

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "ur10e" / "scene.toml"
STEADY_S = 1.3, 2.6


def test_a_finger_is_where_it_is_in_the_world(tmp_path):
    """In the example with another seed."""
    arm = f'arm = "{EXAMPLE.parent / "arm.toml"}"\nseed = 1907'
    scene = load_scene(put(tmp_path, "scene.toml", EXAMPLE.read_text().replace('arm = "arm.toml"', arm)))
    names = [link.name for link in scene.arm.links]
    frames, off, times = RobotFrames(scene.arm), [], []
    with skinbus.simulate(scene) as skin:
        for cycle in skin:
            t_s = skin.period_s * (cycle.number - 1)  # samples count from the first SYNC
            if t_s >= STEADY_S[1]:
                break
            if t_s <= STEADY_S[0]:
                continue
            times.append(t_s)
            assert cycle.robot_valid
            (finger,) = (contact for contact in cycle.contacts if contact.link.startswith("forearm"))
            (truth,) = (touch for touch in cycle.truth if touch.link == finger.link)
            X = frames.poses(scene.motion.positions(t_s))[1][names.index(finger.link)]
            off.append(np.linalg.norm(finger.point("base") - (X[:3, :3] @ truth.point + X[:3, 3])))
    moved = scene.motion.positions(times[-1]) - scene.motion.positions(times[0])
    assert np.abs(moved).max() > 1.2  # rad: at 1 rad/s
    assert len(off) > 60
    assert np.sqrt(np.mean(np.square(off))) < 1e-3
