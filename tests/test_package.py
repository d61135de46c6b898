"""The top of the package: what it offers, and that asking for it costs nothing before it is used."""

import tomllib
from pathlib import Path

import skinbus
from tests.run_in_process import run_code

PROMISED = """
Skin Cycle Contact Patch Readings SkinbusError ConfigError AddressError ArgumentError BusError ShareError
ProtocolError LocalProtocolError RemoteProtocolError SdoAborted MissingFileError
"""


def test_every_name_is_offered_and_there():
    assert set(PROMISED.split()) <= set(skinbus.__all__) <= set(dir(skinbus))
    for name in skinbus.__all__:
        assert getattr(skinbus, name).__name__ == name


def test_import_and_dir_load_nothing_heavy():
    code = (
        "import sys, skinbus; dir(skinbus); print({'numpy', 'numba', 'can', 'pydantic'} & set(sys.modules))"
    )
    assert run_code(code) == "set()"


ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_licence_names_all_that_ships():
    assert PROJECT["license"] == "MIT"
    assert all((ROOT / file).is_file() for file in PROJECT["license-files"])
    others = [path for path in (ROOT / "skinbus").rglob("LICENSE*") if path.is_file()]
    assert {str(path.relative_to(ROOT)) for path in others} <= set(PROJECT["license-files"])
