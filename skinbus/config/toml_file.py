"""TOML files: found by a name that ships with skinbus or by a path, and read with faults that say where."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skinbus.errors import ConfigError, Fault


def find_toml(name_or_path: str | Path, folder: Path, what: str) -> Path:
    """Return the path that is asked for, or the file of that name in ``folder``.

    A bare word is a name; spaces in it are as good as hyphens.

    Raises:
        ConfigError: there is no such ``what``; the message lists the names known.
    """
    path = Path(name_or_path)
    is_name = not path.suffix and path.name == str(name_or_path)
    shipped = folder / f"{'-'.join(str(name_or_path).split())}.toml"
    if is_name and not path.is_file():
        path = shipped
    if path.is_file():
        return path
    wanted = f"a file, or one of {', '.join(names_in(folder))}"
    if path.is_dir():
        wanted = "a file, not a folder"
    raise ConfigError(str(name_or_path), [Fault(what, str(name_or_path), wanted)])


def names_in(folder: Path) -> Sequence[str]:
    """Return the names of the TOML files of a folder, in order."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Raises:
        ConfigError: it cannot be read, or is not TOML; the fault says line and column.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(
            str(path), [Fault("file", None, f"one that can be read ({error.strerror})")]
        ) from error
    except UnicodeDecodeError as error:
        raise ConfigError(str(path), [Fault(f"byte {error.start}", None, "text in UTF-8")]) from None
    except tomllib.TOMLDecodeError as error:
        message, _, place = str(error).partition(" (at ")
        where = place.rstrip(")") or "file"
        raise ConfigError(str(path), [Fault(where, None, f"TOML: {message}")]) from None
