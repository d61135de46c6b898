"""`skinbus configure` against simulated patches."""

import pytest

from skinbus.sim import World, load_scene
from tests.files import put

pytestmark = pytest.mark.slow

ARM = """
[arm]
name = "two"
rate_hz = 50.0
[[link]]
name = "plate"
surface = "plane"
length_mm = 110.0
width_mm = 50.0
[[patch]]
node_id = 1
link = "plate"
s_mm = 27.0
[patch.set]
"Touch Pa" = 1500
"Tactel gain" = [1.0, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1, 1.1]
[[patch]]
node_id = 2
link = "plate"
s_mm = 80.0
[patch.set]
"Touch Pa" = 1500
"""


def test_two_simulated_patches_are_configured_and_then_are_as_asked(own_bus, tmp_path):
    put(tmp_path, "two.toml", ARM)
    scene = f'[scene]\ntitle = "nothing touches"\narm = "{tmp_path / "two.toml"}"\nduration_s = 10.0\n'
    with own_bus.with_cores(World(load_scene(put(tmp_path, "still.toml", scene)))):
        for options, status, said in (
            (["--dry-run"], 1, "2 would change"),
            ([], 0, "2 changed"),
            ([], 0, "2 as asked"),
        ):
            answer = own_bus.run("configure", tmp_path / "two.toml", *options, status=status)
            assert answer.splitlines()[-1] == f"two, 2 patches: {said}"


def test_no_patch_on_the_bus_is_status_1_and_said(own_bus):
    assert "pad, 1 patch: 1 absent" in own_bus.run("configure", "pad", status=1)
