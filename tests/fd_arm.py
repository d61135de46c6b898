"""Two boards on CAN FD and a press, as files: for the tests of the virtual wire and of the real bus alike."""

from tests.files import put

PATCHES = [("skin-patch-fd", 16), ("skin-patch-fd32", 32)]
"""EDS and number of tactels."""
CAN_FD = "canfd = true\ndata_bitrate = 5_000_000\n"
PRESS_S = 0.055
"""Where the press is along the plate, m."""

ARM = """
[arm]
name = "fd"
rate_hz = 50.0
{canfd}
[[link]]
name = "plate"
surface = "plane"
length_mm = 215.0
width_mm = 60.0
[[patch]]
node_id = 1
link = "plate"
s_mm = 51.0
eds = "{eds}"
[[patch]]
node_id = 2
link = "plate"
s_mm = 152.0
eds = "{eds}"
"""
SCENE = f"""
[scene]
title = "a press"
arm = "{{arm}}"
duration_s = 1000.0
[[touch]]
link = "plate"
s_mm = {1e3 * PRESS_S}
a_mm = 4.0
force_n = 5.0
start_s = 0.0
end_s = 1000.0
"""


def write_arm(folder, eds, canfd=CAN_FD):
    """Write the arm file into a folder; return its path."""
    return put(folder, "fd.toml", ARM.format(eds=eds, canfd=canfd))


def write_scene_file(folder, eds):
    """Write the arm and scene files into a folder; return the path of the scene."""
    return put(folder, "scene.toml", SCENE.format(arm=write_arm(folder, eds)))
