"""The profile page is what the EDS files and the rules make of it."""

from pathlib import Path

from tools.profile_page import page

PAGE = Path(__file__).parents[2] / "docs" / "profile.md"


def test_page_is_up_to_date():
    assert PAGE.read_text() == page(), "remake it: python -m tools.profile_page"
