"""`skinbus plan coverage`: table and report of an arm."""

import pytest
from click.testing import CliRunner

from skinbus.cli import group


@pytest.mark.slow
def test_an_arm_is_shown_by_link_and_on_a_page(tmp_path):
    page = tmp_path / "c.html"
    words = ["plan", "coverage", "arm", "--step-mm", "5", "--report", str(page)]
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
    assert "<svg" in page.read_text()
