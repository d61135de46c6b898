"""Which code made a figure or table: a stamp beside each, so that one made by other code is found."""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from skinbus.jit.sources import PACKAGE, sources_of

FILE: Final = "sources.json"
UNRELATED: Final = ("jit", "errors.py")
"""Parts of skinbus that change no number."""


def code_stamp(modules: Iterable[str]) -> str:
    """Return what changes with the code of modules and of all of skinbus that they import.

    Comments, docstrings and layout do not matter.
    """
    files: set[str] = set()
    for module in modules:
        spec = find_spec(module)
        if spec is None or spec.origin is None:
            raise ModuleNotFoundError(f"no module {module}")
        files |= sources_of(spec.origin)
    skipped = tuple(str(PACKAGE / name) for name in UNRELATED)
    digests = sorted(_digest(file) for file in files if not file.startswith(skipped))
    return hashlib.sha256("".join(digests).encode()).hexdigest()[:12]


@cache
def _digest(file: str) -> str:
    tree = ast.parse(Path(file).read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            # a docstring, and the strings below constants that document them
            node.body = [line for line in body if not _is_text(line)]  # type: ignore[attr-defined]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


def _is_text(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def write_stamp(folder: Path, name: str, command: str, modules: Iterable[str]) -> Path:
    """Note in a folder which code made something in it, and by which command; return the file."""
    file = folder / FILE
    entries = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    modules = sorted(modules)
    entries[name] = {"command": command, "modules": modules, "sources": code_stamp(modules)}
    file.write_text(json.dumps(entries, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    return file


def outdated(folder: Path) -> list[str]:
    """Return a line for everything in a folder that other code has made."""
    entries = json.loads((folder / FILE).read_text(encoding="utf-8"))
    return [
        f"{folder / name} was made by other code: `{entry['command']}` makes it anew"
        for name, entry in sorted(entries.items())
        if entry["sources"] != code_stamp(entry["modules"])
    ]
