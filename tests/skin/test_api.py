"""What a program has of ``import skinbus``: names, errors of Python's kinds, and what a skin says it is."""

from typing import get_args, get_type_hints

import pytest

import skinbus
from skinbus.errors import AddressError, ArgumentError, BusError, ConfigError
from skinbus.estimate import LEVELS
from tests.skin.scenes import write


def test_levels_are_a_literal():
    for function in (skinbus.open, skinbus.replay, skinbus.simulate):
        assert get_args(get_type_hints(function)["level"]) == LEVELS


@pytest.mark.parametrize(
    "ask",
    [
        lambda: skinbus.open("no-such-arm"),
        lambda: skinbus.listen("no/such/arm.toml"),
        lambda: skinbus.simulate("no-such-scene"),
        lambda: skinbus.replay("no-such.log", "pad"),
    ],
)
def test_a_missing_file_is_what_python_users_expect(ask):
    with pytest.raises(FileNotFoundError, match=r"no.such") as raised:
        ask()
    assert isinstance(raised.value, ConfigError)
    assert "wanted" in str(raised.value)


@pytest.mark.parametrize(
    ("name", "settings", "error", "said"),
    [
        ("open", {"level": "best"}, ArgumentError, "no level is called 'best'; there are kmeans, fit, full"),
        ("simulate", {"level": "best"}, ArgumentError, "no level is called 'best'"),
        ("open", {"interface": "virtuel"}, AddressError, "unknown interface"),
        ("open", {"interface": "socketcan", "channel": "nocan7"}, BusError, "nocan7"),
    ],
)
def test_what_is_wrong_is_an_error_of_the_tree(name, settings, error, said):
    with pytest.raises(error, match=said):
        getattr(skinbus, name)("pad", **settings)


def test_a_skin_says_what_it_is(tmp_path):
    scene = write(tmp_path)
    with skinbus.simulate(scene, level="kmeans") as skin:
        skin.latest()
        assert repr(skin) == f"<Skin 'pad': 1 patch, scene {scene}, cycle 1>"
    assert repr(skin).endswith(", ended>")
