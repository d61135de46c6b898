"""The covers of a UR10e, end to end: contacts in the base frame while joints move at 1 rad/s."""

import re
from itertools import takewhile
from pathlib import Path

import numpy as np
import pytest

import skinbus
from skinbus.robot import RobotFrames
from skinbus.sim import load_scene

pytest.importorskip("yourdfpy", reason="extra skinbus[robot]")
pytest.importorskip("potpourri3d", reason="extra skinbus[mesh]")

pytestmark = (
    pytest.mark.slow
)  # 24 boards from scene to master; frames and meshes have quick tests of their own

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "ur10e" / "scene.toml"
STEADY_S = 1.3, 2.6


@pytest.fixture(scope="module")
def cycles(tmp_path_factory):
    """Cycles of the example with another seed, for each what was true: times, touches, joints."""
    text = EXAMPLE.read_text().replace(
        'arm = "arm.toml"', f'arm = "{EXAMPLE.parent / "arm.toml"}"\nseed = 1907'
    )
    assert len(re.findall("seed", text)) == 1
    path = tmp_path_factory.mktemp("ur10e") / "scene.toml"
    path.write_text(text)
    scene = load_scene(path)
    with skinbus.simulate(scene) as skin:
        # samples count from the first SYNC
        timed = ((skin.period_s * (cycle.number - 1), cycle) for cycle in skin)
        every = takewhile(lambda item: item[0] < STEADY_S[1], timed)
        return scene, [(t_s, cycle) for t_s, cycle in every if t_s > STEADY_S[0]]


def test_a_finger_is_where_it_is_in_the_world(cycles):
    scene, steady = cycles
    names = [link.name for link in scene.arm.links]
    frames, off, force = RobotFrames(scene.arm), [], []
    for t_s, cycle in steady:
        assert cycle.robot_valid
        (finger,) = (contact for contact in cycle.contacts if contact.link.startswith("forearm"))
        (truth,) = (touch for touch in cycle.truth if touch.link == finger.link)
        X = frames.poses(scene.motion.positions(t_s))[1][names.index(finger.link)]
        off.append(np.linalg.norm(finger.point("base") - (X[:3, :3] @ truth.point + X[:3, 3])))
        force.append(finger.force / truth.force)
    moved = scene.motion.positions(steady[-1][0]) - scene.motion.positions(steady[0][0])
    assert np.abs(moved).max() > 1.2  # rad: at 1 rad/s
    print(f"{1e3 * np.sqrt(np.mean(np.square(off))):.3f} mm RMS, force {np.mean(force):.3f}")
    assert len(steady) > 60
    assert np.sqrt(np.mean(np.square(off))) < 1e-3
