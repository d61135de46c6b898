"""The profile page is what the EDS files and the rules make of it, and every object is on it."""

from pathlib import Path

from click.testing import CliRunner

from skinbus.cli.commands.board import profile as command
from skinbus.cli.profile_page import page
from skinbus.objects.eds import find_eds

PAGE = Path(__file__).parents[2] / "docs" / "profile.md"


def test_page_is_up_to_date():
    assert PAGE.read_text() == page(), "remake it: skinbus board profile --out docs/profile.md"


def test_a_board_of_ones_own_makes_its_table(tmp_path):
    own = tmp_path / "mine.eds"
    own.write_text(
        find_eds("skin-patch").read_text().replace("ParameterName=Healthy tactels", "ParameterName=Mine")
    )
    result = CliRunner().invoke(command, [str(own), "--out", str(tmp_path / "mine.md")])
    assert result.exit_code == 0, result.output
    text = (tmp_path / "mine.md").read_text()
    assert text.startswith("## mine\n")
    assert "| 0x2040 | Mine | UNSIGNED64 | rw |" in text
