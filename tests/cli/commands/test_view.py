"""What `skinbus view` shows of a word: a scene, or an arm on its bus; wrong words are refused in a line."""

import pytest
from click.testing import CliRunner

from skinbus.cli.commands.view import command, is_scene


def test_word_that_names_arm_and_scene_is_a_scene_and_a_file_is_what_its_tables_say(tmp_path):
    assert is_scene("forearm")
    arm = tmp_path / "arm.toml"
    arm.write_text('[arm]\nname = "x"\n')
    assert not is_scene(str(arm))
    scene = tmp_path / "scene.toml"
    scene.write_text('[scene]\narm = "pad"\n')
    assert is_scene(str(scene))
    assert not is_scene(str(tmp_path))


def test_shared_memory_and_a_bus_are_not_shown_at_once():
    result = CliRunner().invoke(command, ["forearm", "--attach", "x", "--channel", "can0"])
    assert result.exit_code == 2
    assert "no bus is used" in result.output


@pytest.mark.parametrize("name", ["field.log", "field.log.gz"])
def test_recording_without_its_arm_is_refused_with_the_option(tmp_path, name):
    (tmp_path / name).write_text("(0.0) can0 080#\n" * 50_000)
    result = CliRunner().invoke(command, [str(tmp_path / name)])
    assert result.exit_code == 2
    assert "a recording needs --arm" in result.output
