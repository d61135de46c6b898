"""`skinbus plan coverage`: table, JSON and report of an arm."""

import json

import pytest
from click.testing import CliRunner

from skinbus.cli import group


@pytest.mark.slow
def test_an_arm_is_shown_by_link_and_written_to_files(tmp_path):
    files = {"json": tmp_path / "c.json", "report": tmp_path / "c.html"}
    options = [word for name, path in files.items() for word in (f"--{name}", str(path))]
    result = CliRunner().invoke(group, ["plan", "coverage", "arm", "--step-mm", "5", *options])
    assert result.exit_code == 0, result.output
    summary = json.loads(files["json"].read_text())
    assert summary["force_n"] == 5.0
    for row in summary["links"]:
        assert row["link"] in result.output
        assert 0.0 <= row["blind_cm2"] <= row["area_cm2"] - 0.5 * row["on_boards_cm2"]
        assert row["least_force_n"][0] < 1.0
        assert row["sd_place_mm"][0] < 1.0
        assert 0.0 < row["bound_holds_pct"] <= 100.0
    assert "<svg" in files["report"].read_text()
