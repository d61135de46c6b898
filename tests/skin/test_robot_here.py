"""Readers of a master elsewhere place its contacts in the frames of the robot as the master itself does."""

import os

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import skinbus
from skinbus.config.system import load_arm
from skinbus.errors import LocalProtocolError, ShareError
from skinbus.skin.cycle import SkinLayout
from skinbus.skin.shared_memory import SharedWriter
from tests.files import put
from tests.robot.two_joints import ARM, FROM_PYTHON, write
from tests.skin.scenes import write as write_slide

pytest.importorskip("yourdfpy", reason="extra skinbus[robot]")

ROUND = """
[arm]
name = "round"
[[link]]
name = "the tube between the shoulder and the elbow"
surface = "cylinder"
length_mm = 140
radius_mm = 40
[[patch]]
node_id = 1
link = "the tube between the shoulder and the elbow"
s_mm = 70
angle_deg = 0
yaw_deg = 0
"""


@pytest.mark.slow
def test_shared_memory_with_an_arm_file_gives_what_the_process_of_the_master_gives(tmp_path):
    folder, name = write(tmp_path, FROM_PYTHON), f"robot-{os.getpid()}"
    n_compared = 0
    with skinbus.simulate(str(folder / "scene.toml")) as skin:
        writer = SharedWriter(name, skin.latest().layout)
        with skinbus.attach(name, arm=folder / "arm.toml") as attached:
            assert attached.joint_names == ("first", "second")
            for cycle in skin:
                writer.write(cycle)
                copy = attached.latest()
                assert copy.robot_valid == cycle.robot_valid
                assert_array_equal(copy.joint_positions, cycle.joint_positions)
                for ours, theirs in zip(copy.contacts, cycle.contacts, strict=True):
                    for of in ("point", "normal"):
                        assert_allclose(getattr(ours, of)("tool"), getattr(theirs, of)("tool"), atol=1e-12)
                    n_compared += np.isfinite(ours.point("base")).all()
                assert_allclose(copy.joint_torques, cycle.joint_torques, atol=1e-12)
                angles = [1e-9 * cycle.ended_ns, 0.4 - 3e-10 * cycle.ended_ns]
                for one in (skin, attached):
                    one.set_joints(angles, t_ns=cycle.ended_ns)
                if cycle.t_ns > 1e9:
                    break
            writer.close()
    assert n_compared > 50


def test_shared_memory_of_another_arm_or_without_an_arm_file_places_nothing(tmp_path):
    folder, name = write(tmp_path, FROM_PYTHON), f"other-{os.getpid()}"
    with skinbus.simulate(write_slide(tmp_path)) as skin:
        writer = SharedWriter(name, skin.latest().layout)
        with skinbus.attach(name) as attached, pytest.raises(LocalProtocolError, match="arm="):
            attached.joints = [0.0, 0.0]
        put(folder, "two.toml", ARM.replace('"plate"', '"lid"'))
        (folder / "two.urdf").write_text((folder / "two.urdf").read_text().replace('"plate"', '"lid"'))
        with pytest.raises(ShareError, match="another arm"):
            skinbus.attach(name, arm=folder / "two.toml")
        writer.close()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("radius_mm = 40", "radius_mm = 41"),
        ("s_mm = 70", "s_mm = 70.1"),
        ("yaw_deg = 0", "yaw_deg = 90"),
        ("elbow", "wrist"),
    ],
)
def test_an_arm_file_whose_numbers_mean_something_else_is_refused(tmp_path, old, new):
    """Links, buses and numbers of tactels are the same: only where things are is not."""
    file, name = tmp_path / "arm.toml", f"moved-{os.getpid()}"
    file.write_text(ROUND)
    writer = SharedWriter(name, SkinLayout.of(load_arm(file)))
    with skinbus.attach(name, arm=file) as skin:
        assert skin.links == ("the tube between the shoulder and the elbow",)
    file.write_text(ROUND.replace(old, new))
    with pytest.raises(ShareError, match="boards or tactels are elsewhere"):
        skinbus.attach(name, arm=file)
    writer.close()
