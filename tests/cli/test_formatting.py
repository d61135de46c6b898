"""Counts in words."""

import pytest

from skinbus.cli.formatting import counted


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
