"""The demo holds contacts against the truth."""

import re

import pytest
from click.testing import CliRunner

from skinbus.cli import group


@pytest.mark.slow
def test_demo_finds_its_touches():
    result = CliRunner().invoke(group, ["demo"])
    assert result.exit_code == 0, result.output
    touches, found = map(int, re.search(r"with (\d+) touches, (\d+) of them", result.output).groups())
    assert found > 0.9 * touches > 500
    assert float(re.search(r"place ([\d.]+) mm", result.output)[1]) < 1.0
