"""What a program has of ``import skinbus``: names, errors of Python's kinds, and what a skin says it is."""

from typing import get_args, get_type_hints

import pytest

import skinbus
from skinbus.errors import ConfigError, SkinbusError
from skinbus.estimate import LEVELS
from tests.skin.scenes import write

ERRORS = ("SkinbusError", "ConfigError", "AddressError", "ArgumentError", "BusError", "ShareError")
ERRORS += ("ProtocolError", "LocalProtocolError", "RemoteProtocolError", "SdoAborted", "MissingFileError")


def test_names_are_those_of_a_program():
    for name in ("Skin", "Cycle", "Contact", "Patch", "Readings", *ERRORS):
        assert name in skinbus.__all__
        assert getattr(skinbus, name).__name__ == name
    assert all(issubclass(getattr(skinbus, name), SkinbusError) for name in ERRORS)
    assert set(dir(skinbus)) >= {*skinbus.__all__, "__version__"}
    with pytest.raises(AttributeError):
        _ = skinbus.no_such_name


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


def test_a_skin_says_what_it_is(tmp_path):
    scene = write(tmp_path)
    with skinbus.simulate(scene, level="kmeans") as skin:
        skin.latest()
        assert repr(skin) == f"<Skin 'pad': 1 patch, scene {scene}, cycle 1>"
    assert repr(skin).endswith(", ended>")
