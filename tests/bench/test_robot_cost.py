"""What the robot adds to a cycle: seven joints, 16 contacts; beside a cycle of 24 patches.

python -m pytest tests/bench/test_robot_cost.py tests/bench/test_cycle.py --benchmark-enable
"""

from types import SimpleNamespace

import numpy as np
import pytest

from skinbus.master.robot import MasterRobot
from skinbus.node.device import Device
from skinbus.objects.eds import load_eds
from tests.robot.robots import URDF, arm_on, columns_on

pytestmark = pytest.mark.slow
pytest.importorskip("yourdfpy", reason="extra skinbus[robot]")

RAIL = """<link name="floor"/><joint name="rail" type="prismatic"><parent link="floor"/>
<child link="base_link"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
JOINTS = ["rail", "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"]
JOINTS += ["wrist_1_joint", "wrist_2_joint", "wrist_3_joint"]


def test_seven_joints_and_sixteen_contacts(benchmark, tmp_path):
    path = tmp_path / "on-a-rail.urdf"
    path.write_text((URDF / "ur10e.urdf").read_text().replace("</robot>", RAIL))
    rng = np.random.default_rng(1)
    links = ["upper_arm_link", "forearm_link", "wrist_2_link", "wrist_3_link"]
    arm = arm_on(path, links, rng, tool="tool0")
    robot = MasterRobot(arm)
    assert robot.frames.chain.n_joints == 7
    robot.publish_on([Device(load_eds("skin-master", 127), 127)])
    contacts = columns_on(arm, rng, 16)
    tracks = SimpleNamespace(slot=np.arange(16), row=np.arange(16))
    t_ns = [0]

    def cycle():
        t_ns[0] += 20_000_000
        robot.offer(t_ns[0], dict.fromkeys(JOINTS, 0.1))
        return robot.close(t_ns[0], contacts, tracks, is_blind=False)

    for _ in range(3):
        cycle()
    assert benchmark(cycle).valid
