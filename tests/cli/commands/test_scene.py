"""`skinbus scene`: its lists, its verdict on a file, its prices."""

import subprocess
import sys

import pytest
from click.testing import CliRunner

from skinbus.cli.commands.scene import command


def invoke(*args):
    return CliRunner(env={"COLUMNS": "240"}).invoke(command, args)


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
