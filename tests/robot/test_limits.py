"""Positions beyond the limits of the URDF are refused, with the unit that is wanted."""

import math

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.errors import ArgumentError
from skinbus.master.robot import MasterRobot
from skinbus.robot.chain import SLACK_RAD, check_positions
from tests.cli.invoke import refused
from tests.files import put
from tests.robot.two_joints import FROM_PYTHON, URDF, write


def test_positions_from_a_program_are_within_the_limits_but_for_the_slack(tmp_path):
    chain = MasterRobot(load_arm(write(tmp_path, FROM_PYTHON) / "arm.toml")).frames.chain
    for value in (-3.0 - 0.9 * SLACK_RAD, 0.0, math.pi / 2, 3.0 + 0.9 * SLACK_RAD):
        check_positions(chain, np.array([value, -value]))
    for value in (-3.0 - 1.1 * SLACK_RAD, 90.0):
        with pytest.raises(ArgumentError, match=r"'second' at .* rad; wanted -3 to 3 rad.*, not degrees"):
            check_positions(chain, np.array([0.0, value]))
    prismatic = chain._replace(linear=~chain.linear, kinds=("prismatic", "prismatic"))
    with pytest.raises(ArgumentError, match=r"'first' at 250 m; wanted -3 to 3 m.*metres, not mm"):
        check_positions(prismatic, np.array([250.0, np.nan]))


@pytest.mark.parametrize("words", ["plan arm.toml --compute-us 100", "scene check scene.toml"])
@pytest.mark.parametrize(
    ("urdf", "wanted"),
    [
        ("<robot", "two.urdf"),
        (URDF.replace('<parent link="base"/>', '<parent link="nowhere"/>'), "nowhere"),
        (URDF.replace('xyz="0 0 1"', 'xyz="0 0 0"'), "axis"),
    ],
)
def test_urdf_with_faults_is_refused_before_anything_starts(tmp_path, monkeypatch, words, urdf, wanted):
    monkeypatch.chdir(write(tmp_path))
    put(tmp_path, "two.urdf", urdf)
    assert wanted in refused(*words.split())
