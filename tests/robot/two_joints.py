"""A pad on a robot of two joints, pressed by a finger: files that tests write."""

from tests.files import put

URDF = """<robot name="two"><link name="base"/><link name="upper"/><link name="plate"/>
<joint name="first" type="revolute"><parent link="base"/><child link="upper"/>
  <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="second" type="revolute"><parent link="upper"/><child link="plate"/>
  <origin xyz="0.5 0 0"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
</robot>
"""
ARM = """
[arm]
name = "pad on a robot"
rate_hz = 100.0
[robot]
urdf = "two.urdf"
[[link]]
name = "plate"
surface = "plane"
length_mm = 50.0
width_mm = 50.0
[[patch]]
node_id = 1
link = "plate"
s_mm = 25.0
[[joint]]
name = "second"
fixed_deg = 30
"""
FROM_PYTHON = ARM[: ARM.index("[[joint]]")]
"""Both joints are set by a program."""
SCENE = """
[scene]
title = "a finger on the plate"
arm = "arm.toml"
duration_s = 10.0
[[touch]]
link = "plate"
s_mm = 27.0
a_mm = 3.0
shape = "disc"
diameter_mm = 12.0
force_n = 8.0
start_s = 0.3
end_s = 9.0
[effect.noise]
sigma_pa = 100.0
"""


def write(folder, arm=ARM):
    put(folder, "two.urdf", URDF)
    put(folder, "arm.toml", arm)
    put(folder, "scene.toml", SCENE)
    return folder
