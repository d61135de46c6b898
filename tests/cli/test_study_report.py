"""The page of accuracy: what is measured stands on it, for this arm, and nothing is fetched."""

import re
from html import unescape
from pathlib import Path

import pytest
from click.testing import CliRunner

from skinbus.cli import group
from skinbus.cli.pages.accuracy import accuracy_page
from skinbus.cli.study_report import facts, read_points
from skinbus.config.system import load_arm
from skinbus.study import headline
from skinbus.study.headline import BUDGETS, measure_budgets

TABLE = Path(__file__).parents[2] / "docs" / "figures" / "headline.csv"


def report(*args):
    return CliRunner().invoke(group, ["study", "report", *map(str, args)])


@pytest.fixture
def page(tmp_path):
    out = tmp_path / "accuracy.html"
    result = report("--table", TABLE, "--out", out)
    assert result.exit_code == 0, result.output
    return out.read_text()


def test_every_point_says_its_numbers_when_pointed_at(page):
    rows = TABLE.read_text().splitlines()[1:]
    tips = [unescape(tip) for tip in re.findall(r'data-tip="([^"]*)"', page)]
    assert len(tips) == len(rows)
    for row in rows:
        quoted = re.fullmatch(r'(\w+),"(.*?)",(\d),(\w+),(\d+),([\d.]+),([\d.]+),([\d.]+),.*', row)
        _, condition, _, level, bits, p50, p95, wrong = quoted.groups()
        wanted = (
            f"{level}, {bits} bit\n{condition}\n{float(p95):.2g} mm in 95 of 100 cycles, median "
            f"{float(p50):.2g} mm\ncount wrong in {float(wrong):.0f} %\n"
        )
        assert any(tip.startswith(wanted) for tip in tips), wanted


def test_the_page_says_what_to_run_as_the_table_of_decisions_does(page):
    decided = (TABLE.parents[1] / "accuracy-time.md").read_text()
    for level, bits, error in re.findall(r"\*\*`(\w+)`, (\d+) bit\*\* \| ([\d.]+) mm", decided):
        assert re.search(rf"run <code>{level}</code>, {bits} bit</div><p><b>{error}&nbsp;mm</b>", page)


def test_the_page_fetches_nothing_and_knows_light_and_dark(page):
    assert not re.search(r"""(src|href)\s*=|url\(|@import|https?://""", page)
    assert "prefers-color-scheme:dark" in page
    assert "default-src 'none'" in page


def test_a_table_that_is_none_is_refused_with_all_its_faults(tmp_path):
    lines = TABLE.read_text().splitlines()
    (tmp_path / "bad.csv").write_text(
        "\n".join([lines[0], *(line.replace("fit", "best") for line in lines[1:])])
    )
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    out = tmp_path / "x.html"
    for name, said in (("bad.csv", "wanted one of kmeans, fit, full"), ("other.csv", "wanted arm, bits")):
        result = report("--table", tmp_path / name, "--out", out)
        assert said in str(result.exception)
        assert not out.exists()
    assert str(report("--table", tmp_path / "bad.csv", "--out", out).exception).count("wanted one of") == 10


def test_what_is_no_page_is_not_written_over(tmp_path):
    mine = tmp_path / "mine.html"
    mine.write_text("notes")
    assert report("--table", TABLE, "--out", mine).exit_code == 2
    assert report("--table", TABLE, "--out", tmp_path / "page.csv").exit_code == 2
    assert mine.read_text() == "notes"


def test_budgets_are_measured_and_shown_as_points_of_their_own(monkeypatch):
    monkeypatch.setattr(headline, "PRESSES", 60)  # how good the law is does not matter here
    arm = load_arm("pad")
    whole = next(
        p for p in read_points(TABLE) if (p.arm, p.level, p.bits, p.fingers) == ("pad", "full", 16, 1)
    )
    points = measure_budgets(arm, [whole], trials=20, seed=90_210)
    assert [point.budget_us for point in points] == [
        pytest.approx(share * whole.compute_p99_us, rel=0.5) for share in BUDGETS
    ]
    tips = re.findall(
        r'data-tip="([^"]*)"', accuracy_page([whole, *points], {"pad": facts(arm)}, "as a test")
    )
    assert [", budget " in tip for tip in tips] == [False, True, True, True]
    assert facts(arm).startswith("1 board with 16 tactels on one bus of 1 Mbit/s")


@pytest.mark.slow
def test_an_arm_of_ones_own_is_measured_with_levels_and_budgets(tmp_path):
    out = tmp_path / "pad.html"
    result = report("pad", "--out", out, "--trials", "20", "--seed", "90210")
    assert result.exit_code == 0, result.output
    tips = [unescape(tip) for tip in re.findall(r'data-tip="([^"]*)"', out.read_text())]
    assert len(tips) == 24 + 6
