"""``[robot]`` and ``[[joint]]`` of an arm file: read in SI units, faults with their keys."""

import math

import numpy as np
import pytest

from skinbus.config.arm_file import read_arm_file
from skinbus.config.system import load_arm
from skinbus.errors import ConfigError
from tests.files import put

ARM = """
[arm]
name = "on a robot"
[robot]
urdf = "ur10e.urdf"
base = "base_link"
tool = "tool0"
max_age_ms = 20
[[link]]
name = "upper_arm_link"
surface = "cylinder"
length_mm = 400
radius_mm = 60
xyz_mm = [10, 20, 30]
rpy_deg = [90, 0, 90]
[[link]]
name = "fore arm"
frame = "forearm_link"
surface = "plane"
length_mm = 100
width_mm = 60
[[patch]]
node_id = 5
link = "upper_arm_link"
s_mm = 100
[[joint]]
name = "elbow_joint"
sd_deg = 0.1
[[joint]]
name = "rail"
fixed_mm = 250
"""


def read(tmp_path, text):
    return read_arm_file(put(tmp_path, "x.toml", text))


def test_the_robot_is_read_in_si_units(tmp_path):
    file = read(tmp_path, ARM)
    assert file.faults == []
    robot = file.robot
    assert (robot.urdf, robot.base, robot.tool) == (str(tmp_path / "ur10e.urdf"), "base_link", "tool0")
    assert robot.max_age_ns == 20_000_000
    upper, fore = robot.links
    assert (upper.name, fore.name) == ("upper_arm_link", "forearm_link")
    np.testing.assert_allclose(upper.X_LS[:3, 3], [0.01, 0.02, 0.03])
    # roll 90 brings y to z, then yaw 90 brings x to y
    np.testing.assert_allclose(upper.X_LS[:3, :3], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15)
    np.testing.assert_array_equal(fore.X_LS, np.eye(4))
    elbow, rail = robot.joints
    assert (elbow.fixed, elbow.is_linear) == (None, False)
    assert elbow.sd == pytest.approx(math.radians(0.1))
    assert (rail.fixed, rail.is_linear) == (0.25, True)


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("max_age_ms = 20", "max_age_ms = 0", "robot.max_age_ms: is 0; wanted greater than 0"),
        (
            "xyz_mm = [10, 20, 30]",
            "xyz_mm = [10, 20]",
            "link[1].xyz_mm: is [10, 20]; wanted at least 3 items",
        ),
        (
            'name = "rail"',
            'name = "elbow_joint"',
            "joint[2].name: is 'elbow_joint'; wanted another: joint[1]",
        ),
        ("sd_deg = 0.1", "sd_deg = 0\nfixed_mm = 1", "joint[1]: is 'fixed_mm and sd_deg'; wanted keys in"),
        ("sd_deg = 0.1", "sd_deg = -1", "joint[1].sd_deg: is -1; wanted greater than or equal to 0"),
        ("sd_deg = 0.1", "typo = 1", "joint[1].typo: is 1; wanted no such key"),
        ('[robot]\nurdf = "ur10e.urdf"', "[robot]", "robot.urdf: wanted a value"),
    ],
)
def test_a_fault_is_reported_with_key_and_value(tmp_path, old, new, fault):
    assert old in ARM
    faults = [str(found) for found in read(tmp_path, ARM.replace(old, new, 1)).faults]
    assert any(found.startswith(fault) for found in faults), faults


def test_keys_of_a_robot_are_refused_without_one(tmp_path):
    head, _, rest = ARM.partition("[robot]")
    text = head + rest[rest.index("[[link]]") :]
    keys = [fault.key for fault in read(tmp_path, text).faults]
    assert keys == ["link[1].xyz_mm", "link[1].rpy_deg", "link[2].frame", "joint[1]", "joint[2]"]
    with pytest.raises(ConfigError, match=r"link\[2\].frame: is 'forearm_link'; wanted \[robot\]"):
        load_arm(tmp_path / "x.toml")
