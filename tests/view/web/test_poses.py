"""Links are drawn where the robot has them, and in a row where there is no robot."""

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.view.web.poses import in_a_row, placed, turned


def test_links_without_a_robot_stand_in_a_row_and_do_not_overlap():
    arm = load_arm("arm")
    poses = in_a_row(arm)
    ends = []
    for X, link in zip(poses.X_BS, arm.links, strict=True):
        points, _ = link.surface.position([0.0, link.surface.length], 0.0)
        ends.append(placed(X, points)[:, 0])
    assert (np.diff(np.ravel(ends)) > 0.0).all()
    assert "no [robot]" in poses.note
    assert in_a_row(load_arm("forearm")).note == ""


def test_points_are_moved_and_directions_turned():
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], (1.0, 2.0, 3.0)
    assert placed(X, np.array([1.0, 0.0, 0.0])) == pytest.approx([1.0, 3.0, 3.0])
    assert turned(X, np.array([1.0, 0.0, 0.0])) == pytest.approx([0.0, 1.0, 0.0])
