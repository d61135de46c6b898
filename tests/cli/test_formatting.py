"""Counts and flags in words."""

from pathlib import Path

import pytest

from skinbus.cli.formatting import counted, words_of
from skinbus.estimate import Quality


@pytest.mark.parametrize(
    ("n", "thing", "words"),
    [
        (0, "contact", "0 contacts"),
        (1, "contact", "1 contact"),
        (1, "patch", "1 patch"),
        (24, "patch", "24 patches"),
    ],
)
def test_one_is_singular(n, thing, words):
    assert counted(n, thing) == words


def test_the_page_of_objects_has_the_value_and_the_name_of_each_flag_of_a_contact():
    page = (Path(__file__).parents[2] / "docs" / "canopen.md").read_text()
    for flag in Quality:
        if flag:
            assert f"| {int(flag)} | {flag.name} |" in page
            assert words_of(int(flag)) == str(flag.name).lower().replace("_", "-")
