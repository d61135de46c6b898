"""The demo holds contacts against the truth."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from skinbus.cli import group
from skinbus.cli.commands.demo import errors_of
from skinbus.estimate import TrackState


def contact(x, force=5.0, state=TrackState.HELD, link="a"):
    return SimpleNamespace(link=link, point=np.array([x, 0.0, 0.0]), force=force, state=state)


@pytest.mark.parametrize(
    ("contacts", "place", "force"),
    [
        ((contact(0.003, 6.0),), 0.003, 0.2),
        ((contact(0.05), contact(0.002, 4.0)), 0.002, 0.2),
        ((contact(0.0, link="b"), contact(0.0, state=TrackState.COAST)), np.inf, np.inf),
        ((), np.inf, np.inf),
    ],
)
def test_each_touch_is_held_against_its_nearest_contact(contacts, place, force):
    cycle = SimpleNamespace(truth=(contact(0.0),), contacts=contacts)
    assert errors_of(cycle) == [pytest.approx((place, force))]


@pytest.mark.slow
def test_demo_finds_its_touches():
    result = CliRunner().invoke(group, ["demo"])
    assert result.exit_code == 0, result.output
    touches, found = map(int, re.search(r"with (\d+) touches, (\d+) of them", result.output).groups())
    assert found > 0.9 * touches > 500
    assert float(re.search(r"place ([\d.]+) mm", result.output)[1]) < 1.0
