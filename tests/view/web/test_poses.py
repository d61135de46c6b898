"""Links are drawn where the robot has them, and in a row where there is no robot."""

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.view.web.poses import Poses, placed
from tests.robot.two_joints import FROM_PYTHON, write


def test_links_without_a_robot_stand_in_a_row_and_do_not_overlap():
    arm = load_arm("arm")
    poses = Poses(arm)
    ends = []
    for X, link in zip(poses.X_BS, arm.links, strict=True):
        points, _ = link.surface.position([0.0, link.surface.length], 0.0)
        ends.append(placed(X, points)[:, 0])
    assert (np.diff(np.ravel(ends)) > 0.0).all()
    assert "no [robot]" in poses.note
    assert Poses(load_arm("forearm")).note == ""


def test_links_follow_the_joints_where_these_are_known(tmp_path):
    pytest.importorskip("yourdfpy", reason="extra skinbus[robot]")
    poses = Poses(load_arm(write(tmp_path, FROM_PYTHON) / "arm.toml"))
    assert poses.note == "positions are not known of first, second: drawn at 0"
    assert not poses.move(np.array([np.nan, 0.0]))
    before = poses.X_BS
    assert poses.move(np.array([0.5, 0.0]))
    assert (poses.note, poses.joints) == ("", {"first": 0.5, "second": 0.0})
    assert np.arctan2(*(before[0, :3, 0] @ poses.X_BS[0, :3, k] for k in (1, 0))) == pytest.approx(-0.5)
    assert not poses.move(np.array([0.5005, 0.0]))
