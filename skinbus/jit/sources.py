"""Which sources a compiled kernel is made from: its module and all of skinbus that this imports."""

from __future__ import annotations

import hashlib
import os
import re
from functools import cache
from pathlib import Path
from typing import Final

PACKAGE: Final = Path(__file__).resolve().parents[1]
IMPORTS: Final = re.compile(
    r"^[ \t]*(?:from (skinbus[\w.]*) import (\([^)]*\)|[^\n]*)|import (skinbus[\w.]*))", re.MULTILINE
)
NAMES: Final = re.compile(r"\w+")


def sources_stamp(file: str, package: Path = PACKAGE) -> str:
    """Return what changes with a file, or with any source of a package that it imports, directly or not.

    A kernel contains all that it calls and every constant that it reads. Where the files lie does not
    matter: the same sources at another place have the same stamp.
    """
    files = sources_of(file, package)
    return hashlib.sha256(b"".join(sorted(_read(path, str(package.parent))[0] for path in files))).hexdigest()


def sources_of(file: str, package: Path = PACKAGE) -> set[str]:
    """Return a file, the sources of a package that it imports, directly or not, and those of its ``jit``."""
    seen: set[str] = set()
    todo = [os.path.realpath(file), *_sources_in(str(package / "jit"))]
    while todo:
        path = todo.pop()
        if path not in seen:
            seen.add(path)
            todo += _read(path, str(package.parent))[1]
    return seen


@cache
def _sources_in(folder: str) -> frozenset[str]:
    """Return the sources in a folder, none where there is no such folder."""
    try:
        return frozenset(f"{folder}/{name}" for name in os.listdir(folder) if name.endswith(".py"))
    except (FileNotFoundError, NotADirectoryError):
        return frozenset()


@cache
def _read(path: str, root: str) -> tuple[bytes, tuple[str, ...]]:
    """Return the digest of a file, and the files below a root that it imports: modules and ``__init__``."""
    content = Path(path).read_bytes()
    found: set[str] = set()
    for module, names, plain in IMPORTS.findall(content.decode()):
        base = f"{root}/{(module or plain).replace('.', '/')}"
        found |= {f"{base}.py"} & _sources_in(os.path.dirname(base))
        found |= {f"{base}/{name}.py" for name in ["__init__", *NAMES.findall(names)]} & _sources_in(base)
    return hashlib.sha256(content).digest(), tuple(found)
