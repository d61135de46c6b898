"""`skinbus plan coverage`: table, JSON and report of an arm."""

import json

import pytest
from click.testing import CliRunner

from skinbus.cli import group


@pytest.mark.slow
def test_an_arm_is_shown_with_worst_places_and_bare_areas_and_written_to_files(tmp_path):
    files = {"json": tmp_path / "c.json", "report": tmp_path / "c.html"}
    options = [word for name, path in files.items() for word in (f"--{name}", str(path))]
    result = CliRunner().invoke(group, ["plan", "coverage", "arm", "--step-mm", "5", *options])
    assert result.exit_code == 0, result.output
    for words in ("least force, N", "worst_places", "bare_areas", "area_cm2"):
        assert words in result.output
    summary = json.loads(files["json"].read_text())
    assert summary["force_n"] == 5.0
    worst = [row["value"] for row in summary["worst_places"] if row["what"].endswith("place, mm")]
    finite = [value for value in worst if value is not None]
    assert worst == [None] * (len(worst) - len(finite)) + sorted(finite, reverse=True)
    areas = [row["area_cm2"] for row in summary["bare_areas"]]
    assert areas == sorted(areas, reverse=True)
    assert "<svg" in files["report"].read_text()
