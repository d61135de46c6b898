"""`skinbus scene`: its lists, its verdict on a file, its prices."""

import re
import subprocess
import sys

import pytest
from click.testing import CliRunner

from skinbus.cli.commands.scene import command
from skinbus.sim import load_scene, scene_names
from skinbus.sim.bare_skin import bare_touches
from skinbus.sim.effects import ORDER


def invoke(*args):
    return CliRunner(env={"COLUMNS": "240"}).invoke(command, args)


@pytest.mark.slow
def test_list_has_one_line_for_every_scene_and_every_effect():
    result = invoke("list")
    assert result.exit_code == 0
    first_words = [line.split()[0] for line in result.output.splitlines() if line.strip()]
    for name in (*scene_names(), *ORDER, "elastic", "cone"):
        assert first_words.count(name) == 1, name
    assert "sigma_pa=200 Pa" in result.output


def test_list_of_names_explains_their_parameters():
    result = invoke("list", "noise", "elastic")
    assert result.exit_code == 0
    for word in ("sigma_pa", "200 Pa", "standard deviation", "poisson"):
        assert word in result.output
    assert invoke("list", "nois").exit_code == 2


def test_check_says_that_a_file_is_right(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('[scene]\narm = "pad"\nduration_s = 1\n[effect.noise]\n')
    result = invoke("check", str(path))
    assert result.exit_code == 0
    assert "no faults" in result.output


TOUCH = """[[touch]]
link = "tube"
force_n = {force}
{place}
"""


def test_check_names_touches_that_no_tactel_shows(tmp_path):
    path = tmp_path / "bare.toml"
    places = [
        (8, "s_mm = 26\nangle_deg = 0"),  # a board
        (8, "s_mm = 26\nangle_deg = 90"),
        (0.001, "s_mm = 26\nangle_deg = 0"),
        (8, "path = [[0, 26, 0], [4, 26, 90]]"),
    ]
    touches = "".join(TOUCH.format(force=force, place=place) for force, place in places)
    path.write_text('[scene]\narm = "one.toml"\nduration_s = 4\n' + touches)
    (tmp_path / "one.toml").write_text(
        '[arm]\nname = "one"\n[[link]]\nname = "tube"\nsurface = "cylinder"\nlength_mm = 60\nradius_mm = 50\n'
        '[[patch]]\nnode_id = 1\nlink = "tube"\ns_mm = 30\nangle_deg = 0\n'
    )
    result = invoke("check", str(path))
    assert result.exit_code == 0
    notes = [line for line in result.output.splitlines() if line.startswith("note:")]
    assert [note.split()[2] for note in notes] == ["2", "3", "4"]
    assert "touch 2 (8 N) makes no contact: the nearest tactel, 6" in notes[0]  # mm away, round the tube
    assert re.search(r"for [4-6]\d % of its time", notes[2])


@pytest.mark.parametrize("name", scene_names())
def test_no_touch_of_a_scene_that_ships_is_on_bare_skin(name):
    assert bare_touches(load_scene(name)) == []


@pytest.mark.slow
def test_cost_lists_every_part_and_the_whole():
    result = invoke("cost", "dying-patch", "--cycles", "5")
    assert result.exit_code == 0
    for name in ("boards and frames", "touches", "noise", "dead", "stuck", "patch_silent", "whole"):
        assert name in result.output


@pytest.mark.slow
def test_bad_scene_is_one_message_with_every_fault_and_status_2(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text('[scene]\narm = "pad"\nduration_s = -1\n[effect.nois]\n[effect.loss]\nprobability = 2\n')
    done = subprocess.run(
        [sys.executable, "-m", "skinbus", "scene", "check", str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "3 faults" in done.stderr
    for key in ("scene.duration_s", "effect.nois", "effect.loss.probability"):
        assert key in done.stderr
    assert "Traceback" not in done.stderr
