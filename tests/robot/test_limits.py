"""Positions beyond the limits of the URDF are refused, with the unit that is wanted."""

import math

import numpy as np
import pytest
from click.testing import CliRunner

from skinbus.cli.commands import plan, scene
from skinbus.config.system import load_arm
from skinbus.errors import ArgumentError, SkinbusError
from skinbus.master.robot import MasterRobot
from skinbus.robot.chain import SLACK_RAD, check_positions
from tests.robot.two_joints import ARM, URDF, write

HEAD = ARM[: ARM.index("[[joint]]")]


def robot(folder, joints):
    return MasterRobot(load_arm(str(write(folder, HEAD + joints) / "arm.toml")))


def test_positions_from_a_program_are_within_the_limits_but_for_the_slack(tmp_path):
    chain = robot(tmp_path, "").frames.chain
    for value in (-3.0 - 0.9 * SLACK_RAD, 0.0, math.pi / 2, 3.0 + 0.9 * SLACK_RAD):
        check_positions(chain, np.array([value, -value]))
    for value in (-3.0 - 1.1 * SLACK_RAD, 90.0):
        with pytest.raises(ArgumentError, match=r"'second' at .* rad; wanted -3 to 3 rad.*, not degrees"):
            check_positions(chain, np.array([0.0, value]))
    prismatic = chain._replace(linear=~chain.linear, kinds=("prismatic", "prismatic"))
    with pytest.raises(ArgumentError, match=r"'first' at 250 m; wanted -3 to 3 m.*metres, not mm"):
        check_positions(prismatic, np.array([250.0, np.nan]))


@pytest.mark.parametrize(
    ("command", "words"),
    [(plan.command, ["arm.toml", "--compute-us", "100"]), (scene.command, ["check", "scene.toml"])],
    ids=["plan", "scene"],
)
@pytest.mark.parametrize(
    ("urdf", "wanted"),
    [
        (None, "two.urdf"),
        ("<robot", "two.urdf"),
        (URDF.replace('<parent link="base"/>', '<parent link="nowhere"/>'), "nowhere"),
        (URDF.replace('xyz="0 0 1"', 'xyz="0 0 0"'), "axis"),
    ],
)
def test_urdf_with_faults_is_refused_before_anything_starts(
    tmp_path, monkeypatch, command, words, urdf, wanted
):
    monkeypatch.chdir(write(tmp_path))
    (tmp_path / "two.urdf").unlink()
    if urdf is not None:
        (tmp_path / "two.urdf").write_text(urdf)
    result = CliRunner().invoke(command, words)
    assert isinstance(result.exception, SkinbusError)
    assert wanted in str(result.exception)
