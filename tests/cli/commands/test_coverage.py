"""`skinbus plan coverage`: table and figure of an arm."""

import pytest
from click.testing import CliRunner

from skinbus.cli import group


@pytest.mark.slow
def test_an_arm_is_shown_by_link_and_in_a_figure(tmp_path):
    figure = tmp_path / "c.svg"
    words = ["plan", "coverage", "arm", "--step-mm", "5", "--figure", str(figure)]
    result = CliRunner().invoke(group, words)
    assert result.exit_code == 0, result.output
    titles, *rows = (line.split("  ") for line in result.output.splitlines()[:3])
    titles, *rows = ([cell.strip() for cell in row if cell.strip()] for row in (titles, *rows))
    for cells in rows:
        row = dict(zip(titles, cells, strict=True))
        assert 0.0 <= float(row["blind_cm2"]) <= float(row["area_cm2"]) - 0.5 * float(row["on_boards_cm2"])
        for name in ("least_force_n", "sd_place_mm"):
            assert float(row[name].split(", ")[0]) < 1.0
        assert 0.0 < float(row["bound_holds_pct"]) <= 100.0
    assert "<svg" in figure.read_text()
