"""The demo holds contacts against the truth."""

import re

import pytest

from tests.cli.invoke import run


@pytest.mark.slow
def test_demo_finds_its_touches():
    said = run("demo")
    touches, found = map(int, re.search(r"with (\d+) touches, (\d+) of them", said).groups())
    assert found > 0.9 * touches > 500
    assert float(re.search(r"place ([\d.]+) mm", said)[1]) < 1.0
