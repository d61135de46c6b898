"""TOML files: found by a name that ships with skinbus or by a path, and read with faults that say where."""

from __future__ import annotations

import os
import re
import tomllib
from pathlib import Path
from typing import Any

from skinbus.config.wording import nearest
from skinbus.errors import ConfigError, MissingFileError
from skinbus.file_bytes import read_bytes

MAX_BYTES = 1 << 19
"""An arm of 16 buses with 126 patches each, a hundred bytes for each patch, is half of this."""

_OPAQUE = re.compile(
    r'''"""(?:[^"\\]|\\.|"(?!""))*+(?:"""|\Z)|"(?:[^"\\\n]|\\.)*+(?:"|$)'''
    r"""|'''(?:[^']|'(?!''))*+(?:'''|\Z)|'[^'\n]*+(?:'|$)|#[^\n]*+""",
    re.DOTALL | re.MULTILINE,
)
"""Strings and comments."""
_BEYOND = {
    r"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){16}": "keys of at most 16 parts",
    r"(?<![\w+.:-])[\w+.:-]{101}": "numbers and keys of at most 100 characters",
}
"""What costs the parser too much: its time grows with the square of a key's parts and of digits. Keys of ours
have four parts, and 64 bits 20 digits."""


def find_toml(name_or_path: str | Path, folder: Path, what: str) -> Path:
    """Return the path that is asked for, or the file of that name in ``folder``.

    A bare word is a name; spaces in it are as good as hyphens.

    Raises:
        ConfigError: there is no such ``what``; the message lists the names known.
    """
    path = Path(name_or_path)
    is_name = not path.suffix and path.name == str(name_or_path)
    shipped = folder / f"{'-'.join(str(name_or_path).split())}.toml"
    if is_name and not os.path.isfile(path):
        path = shipped
    if os.path.isfile(path):  # False, not an OSError, for a name longer than any
        return path
    name, known = str(name_or_path), names_in(folder)
    if os.path.isdir(path):
        raise ConfigError.of(name, what, name, "a file, not a folder")
    hint = nearest(path.stem, known) if is_name else ""
    raise MissingFileError.of(
        name, what, name, f"a file that can be read, or one of {', '.join(known)}{hint}"
    )


def names_in(folder: Path) -> list[str]:
    """Return the names of the TOML files of a folder, in order."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Raises:
        ConfigError: it cannot be read, is not TOML, or larger or deeper than any file of ours; the fault says
            line and column.
    """
    try:
        text = read_bytes(path, MAX_BYTES).decode("utf-8").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise ConfigError.of(path, f"byte {error.start}", None, "a TOML file: text in UTF-8") from None
    plain = _OPAQUE.sub("_", text)
    for beyond, wanted in _BEYOND.items():
        if re.search(beyond, plain):
            raise ConfigError.of(path, "file", None, wanted)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ConfigError.of(
            path, "file", None, "tables and arrays that are less deep in each other"
        ) from None
    except tomllib.TOMLDecodeError as error:
        message, _, place = str(error).partition(" (at ")
        raise ConfigError.of(path, place.rstrip(")") or "file", None, f"TOML: {message}") from None
