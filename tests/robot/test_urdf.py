"""A URDF with faults is refused with all of them, each with its line and element."""

import re

import numpy as np
import pytest

from skinbus.errors import ConfigError
from skinbus.model import JointSettings
from skinbus.robot.chain import load_chain
from skinbus.robot.urdf import read_urdf
from tests.files import put
from tests.robot.robots import URDF, arm_on

pytest.importorskip("yourdfpy", reason="extra skinbus[robot]")

FAULTY = """\
<robot name="faulty">
<link name="a"/><link name="b"/><link name="c"/><link/><link name="a"/><link name="alone"/>
<joint name="one" type="revolut"><parent link="a"/><child link="b"/></joint>
<joint name="two" type="revolute"><parent link="b"/><child link="nowhere"/><axis xyz="0 0 0"/></joint>
<joint name="three" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 one 0"/>
  <origin xyz="1 2" rpy="0 0 nan"/><limit lower="low" upper="1"/></joint>
<joint name="three" type="fixed"><child link="c"/></joint>
</robot>
"""


def faults_of(tmp_path, text):
    path = put(tmp_path, "robot.urdf", text)
    with pytest.raises(ConfigError) as refused:
        read_urdf(path)
    assert refused.value.file == str(path)
    return [str(fault) for fault in refused.value.faults]


def test_every_fault_is_reported_with_line_element_and_value(tmp_path):
    faults = faults_of(tmp_path, FAULTY)
    for pattern in (
        r"line 2 <link>: wanted a name$",
        r"line 2 <link a> name: is 'a'; wanted a name that no other has",
        r"line 3 <joint one> type: is 'revolut'; wanted one of revolute, ",
        r"line 4 <joint two> child: is 'nowhere'; wanted the name of a link",
        r"line 4 <joint two> axis.xyz: is '0 0 0'; wanted a direction",
        r"line 5 <joint three> child: is 'b'; wanted a link that one does not carry already",
        r"line 5 <joint three> axis.xyz: is '0 one 0'; wanted three finite numbers",
        r"line 5 <joint three> origin.xyz: is '1 2'; wanted three finite numbers",
        r"line 5 <joint three> origin.rpy: is '0 0 nan'; wanted three finite numbers",
        r"line 5 <joint three> limit.lower: is 'low'; wanted a finite number",
        r"line 7 <joint three> name: is 'three'; wanted a name that no other has",
        r"line 7 <joint three> parent: wanted the name of a link",
        r"line 1 <robot faulty>: is 'a, alone'; wanted one root",
    ):
        assert any(re.match(pattern, fault) for fault in faults), f"{pattern} not in\n" + "\n".join(faults)


def test_a_limit_that_is_not_finite_is_refused_with_its_place(tmp_path):
    robot = """<robot name="r"><link name="a"/>\n<link name="b"/>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/>
<limit effort="x" velocity="1" lower="-1" upper="inf"/></joint></robot>"""
    (fault,) = faults_of(tmp_path, robot)  # effort is not read
    assert re.match(r"line 3 <joint j> limit.upper: is 'inf'; wanted a finite number", fault), fault


@pytest.mark.parametrize(
    ("text", "pattern"),
    [
        ("<robot name='r'><link", r"line 1: wanted XML: "),
        ("<world/>", r"line 1 <world>: wanted <robot>"),
        ("<robot name='r'/>", r"line 1 <robot r>: wanted at least one <link>"),
        (
            "<robot name='r'><link name='a'/><link name='b'/>"
            "<joint name='j' type='fixed'><parent link='a'/><child link='b'/></joint>"
            "<joint name='k' type='fixed'><parent link='b'/><child link='a'/></joint></robot>",
            r"line 1 <robot r>: is 'b'; wanted links without a loop",
        ),
    ],
)
def test_what_is_no_tree_of_links_is_refused(tmp_path, text, pattern):
    assert any(re.match(pattern, fault) for fault in faults_of(tmp_path, text))


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="one that can be read"):
        read_urdf(tmp_path / "none.urdf")


def test_joints_come_in_the_order_of_the_tree():
    root, joints = read_urdf(URDF / "ur10e.urdf")
    assert root == "base_link"
    reached = {root}
    for joint in joints:
        assert joint.parent in reached
        reached.add(joint.child)
    moving = [joint.name for joint in joints if joint.kind != "fixed"]
    assert moving[0] == "shoulder_pan_joint"
    assert len(moving) == 6


MIMIC = """\
<robot name="gripper"><link name="palm"/><link name="left"/><link name="right"/><link name="floater"/>
<joint name="l" type="prismatic"><parent link="palm"/><child link="left"/><axis xyz="1 0 0"/></joint>
<joint name="r" type="prismatic"><parent link="palm"/><child link="right"/><axis xyz="1 0 0"/>
  <mimic joint="l"/></joint>
<joint name="f" type="floating"><parent link="palm"/><child link="floater"/></joint></robot>
"""


def chain_of(path, names, **settings):
    arm = arm_on(path, names, np.random.default_rng(1), **settings)
    return load_chain(arm.robot)


def test_all_names_that_the_urdf_does_not_have_are_reported_at_once():
    joints = [
        JointSettings(name="elbow", key="joint[1]"),
        JointSettings(name="elbow_joint", key="joint[2]", is_linear=True),
    ]
    with pytest.raises(ConfigError) as refused:
        chain_of(URDF / "ur10e.urdf", ["upper_arm", "tool0"], base="wrist_1_link", tool="t", joints=joints)
    keys = [fault.key for fault in refused.value.faults]
    assert keys == ["robot.tool", "link[1].name or .frame", "robot.base", "joint[1].name", "joint[2]"]
    with pytest.raises(ConfigError, match=r"joint\[2\]: is 'elbow_joint'; wanted keys in degrees"):
        chain_of(URDF / "ur10e.urdf", ["tool0"], tool="tool0", joints=joints[1:])


def test_a_tool_frame_is_asked_for_where_there_are_several_ends(tmp_path):
    assert chain_of(URDF / "ur10e.urdf", ["forearm_link"]).n_joints == 6  # to the end of the only branch
    with pytest.raises(
        ConfigError, match=r"robot.tool: wanted the link that is the tool frame, of left, right"
    ):
        chain_of(put(tmp_path, "gripper.urdf", MIMIC), ["left"])
