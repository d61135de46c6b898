"""Which sources a compiled kernel is made from: its module and all of skinbus that this imports."""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]
IMPORTS = re.compile(r"^[ \t]*(?:from|import) (skinbus[\w.]*)(?: import (\([^)]*\)|[^\n]*))?", re.MULTILINE)


@cache
def sources_stamp(file: str, package: Path = PACKAGE) -> str:
    """Return what changes with a file, or with any source of a package that it imports, directly or not.

    A kernel contains all that it calls and every constant that it reads; those of ``jit`` always count. Where
    the files lie does not matter: the same sources at another place have the same stamp.
    """
    digests: dict[Path, bytes] = {}
    todo = [Path(file).resolve(), *(package / "jit").glob("*.py")]
    while todo:
        path = todo.pop()
        if path not in digests:
            digests[path], imported = _read(path, package.parent)
            todo += imported
    return hashlib.sha256(b"".join(sorted(digests.values()))).hexdigest()


@cache
def _read(path: Path, root: Path) -> tuple[bytes, list[Path]]:
    """Return the digest of a file, and the files below a root that it imports: modules and ``__init__``."""
    content = path.read_bytes()
    found = []
    for module, names in IMPORTS.findall(content.decode()):
        base = root.joinpath(*module.split("."))
        found += [
            base.with_suffix(".py"),
            *(base / f"{n}.py" for n in ("__init__", *re.findall(r"\w+", names))),
        ]
    return hashlib.sha256(content).digest(), [each for each in found if each.is_file()]
