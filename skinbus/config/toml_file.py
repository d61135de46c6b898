"""TOML files: found by a name that ships with skinbus or by a path, and read with faults that say where."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from skinbus.config.wording import nearest
from skinbus.errors import ConfigError, Fault, MissingFileError
from skinbus.file_bytes import read_bytes

MAX_BYTES = 1 << 19
"""An arm of 16 buses with 126 patches each, a hundred bytes for each patch, is half of this."""

MAX_DEPTH = 16
"""Of tables and arrays in each other, and parts of a key; files of ours need four."""

MAX_WORD = 100
"""Characters of a number, or of a key without quotes: 64 bits have 20 digits."""

OPAQUE = re.compile(
    r'''"""(?:[^"\\]|\\.|"(?!""))*+(?:"""|\Z)|"(?:[^"\\\n]|\\.)*+(?:"|$)'''
    r"""|'''(?:[^']|'(?!''))*+(?:'''|\Z)|'[^'\n]*+(?:'|$)|#[^\n]*+""",
    re.DOTALL | re.MULTILINE,
)
"""Strings and comments."""
_BRACKET = re.compile(r"[\[\]{}]")
_LONG_KEY = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{MAX_DEPTH}}}")
_LONG_WORD = re.compile(rf"(?<![\w+.:-])[\w+.:-]{{{MAX_WORD + 1}}}")


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
    known = names_in(folder)
    wanted = (
        f"a file that can be read, or one of {', '.join(known)}{nearest(path.stem, known) if is_name else ''}"
    )
    is_folder = os.path.isdir(path)
    if is_folder:
        wanted = "a file, not a folder"
    raise (ConfigError if is_folder else MissingFileError)(
        str(name_or_path), [Fault(what, str(name_or_path), wanted)]
    )


def names_in(folder: Path) -> Sequence[str]:
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
        if faults := list(_beyond(text)):
            raise ConfigError(path, faults)
        return tomllib.loads(text)
    except UnicodeDecodeError as error:
        raise ConfigError.of(path, f"byte {error.start}", None, "a TOML file: text in UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        message, _, place = str(error).partition(" (at ")
        where = place.rstrip(")") or "file"
        raise ConfigError.of(path, where, None, f"TOML: {message}") from None


def _beyond(text: str) -> Iterator[Fault]:
    """Return what would cost the parser too much: its time grows with the square of a key's parts."""
    plain = OPAQUE.sub("_", text)
    depth = 0
    for bracket in _BRACKET.finditer(plain):
        depth = depth + 1 if bracket[0] in "[{" else max(depth - 1, 0)
        if depth > MAX_DEPTH:
            yield Fault("file", None, f"tables and arrays at most {MAX_DEPTH} deep")
            break
    if _LONG_KEY.search(plain):
        yield Fault("file", None, f"keys of at most {MAX_DEPTH} parts")
    if _LONG_WORD.search(plain):
        yield Fault("file", None, f"numbers and keys of at most {MAX_WORD} characters")
