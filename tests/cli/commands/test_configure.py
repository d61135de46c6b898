"""`skinbus configure` against simulated patches."""

import pytest

from skinbus.cli.commands.configure import change_rows, show
from skinbus.cli.console import Console
from skinbus.config.system import load_arm, ods_of
from skinbus.master.patches.provisioning import Change, Provision, Provisioned
from skinbus.sim import World, load_scene

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


def test_table_groups_nodes_and_counts_elements_of_an_array(tmp_path):
    (tmp_path / "two.toml").write_text(ARM)
    arm = load_arm(tmp_path / "two.toml")
    ods = dict(zip((1, 2), ods_of(arm), strict=True))
    one, gain = b"\0\0\x80?", bytes.fromhex("cdcc8c3f")
    touch = Change(0x2030, 1, (2000).to_bytes(4, "little"), (1500).to_bytes(4, "little"))
    gains = tuple(Change(0x2011, k, one, gain) for k in range(2, 17))
    results = {
        1: Provisioned(Provision.CHANGED, "", (touch, *gains)),
        2: Provisioned(Provision.CHANGED, "", (touch,)),
    }
    assert change_rows(ods, results) == {
        ("0x2030:01 Touch Pa", "2000", "1500"): [1, 2],
        ("0x2011 Tactel gain", "15 values", ""): [1],
    }
    console = Console(record=True, width=120)
    show(console, arm, ods, results | {2: Provisioned(Provision.ABSENT, "device type")})
    text = console.export_text()
    for words in (
        "Touch Pa",
        "node 2: absent (no answer: device type)",
        "two, 2 patches: 1 changed, 1 absent",
    ):
        assert words in text


@pytest.mark.slow
def test_two_simulated_patches_are_configured_and_then_are_as_asked(own_bus, tmp_path):
    (tmp_path / "two.toml").write_text(ARM)
    scene = f'[scene]\ntitle = "nothing touches"\narm = "{tmp_path / "two.toml"}"\nduration_s = 10.0\n'
    (tmp_path / "still.toml").write_text(scene)
    outcomes = []
    with own_bus.with_cores(World(load_scene(tmp_path / "still.toml"))):
        for options in (("--dry-run",), (), ()):
            answer = own_bus.run("configure", tmp_path / "two.toml", *options)
            outcomes.append((answer.exit_code, answer.output.splitlines()[-1]))
    assert outcomes == [
        (1, "two, 2 patches: 2 would change"),
        (0, "two, 2 patches: 2 changed"),
        (0, "two, 2 patches: 2 as asked"),
    ]


@pytest.mark.slow
def test_no_patch_on_the_bus_is_status_1_and_said(own_bus):
    answer = own_bus.run("configure", "pad")
    assert (answer.exit_code, "pad, 1 patch: 1 absent" in answer.output) == (1, True), answer.output
