"""Edits of an arm file: tables of boards that change are written anew, all else stays as it was written.

A ring whose boards are no longer alike becomes patches where it stood; comments on lines of their own stay.
What comes out is parsed and compared with what was wanted, so a file that is written in a way that is not
foreseen here is refused, never spoilt.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from skinbus.config.arm_file import check_tables
from skinbus.config.arm_tables import RingTable
from skinbus.config.system import make_arm
from skinbus.config.toml_file import MAX_BYTES
from skinbus.errors import ConfigError
from skinbus.file_bytes import read_bytes, write_whole

Change = Mapping[str, Any]
"""New values by key."""

_HEADER = re.compile(r"^(?=[ \t]*\[\[?[ \t]*([\w-]+)[ \t]*\]\]?[ \t]*(?:#.*)?\r?$)", re.MULTILINE)
"""Of a table; those of tables in it have a point in their names."""


def edit_arm(path: Path, text: str, changes: Mapping[str, Change]) -> str:
    """Return the text of an arm file with other values in its patches.

    changes: by the key of a patch as ``Mounting.key`` has it, ``patch[2]`` or ``ring[1]#3``.

    Raises:
        ConfigError: a table is written in a way that cannot be edited: keys in quotes, tables in one line.
    """
    document, newline = tomllib.loads(text), "\r\n" if "\r\n" in text else "\n"
    wanted: dict[str, list[Any]] = {"patch": [], "ring": []}
    left = {kind: iter(enumerate(document.get(kind, ()), 1)) for kind in wanted}
    edited, *parts = _HEADER.split(text)
    for kind, block in zip(parts[::2], parts[1::2], strict=True):
        number, table = next(left.get(kind, iter(())), (0, None))
        boards = _boards(kind, f"{kind}[{number}]", table) if table else {}
        if boards.keys().isdisjoint(changes):
            edited += block
            if table:
                wanted[kind].append(table)
            continue
        own = [{**board, **changes.get(key, {})} for key, board in boards.items()]
        wanted["patch"] += own
        lines = block.splitlines()
        n = len(lines)
        while not lines[n - 1].partition("#")[0].strip():  # comments before the next table are of that one
            n -= 1
        edited += newline.join([*_as_patches(lines[:n], own), *lines[n:], ""])
    try:
        is_good = _filled(tomllib.loads(edited)) == _filled({**document, **wanted})
    except tomllib.TOMLDecodeError:
        is_good = False
    if not is_good:
        keys = ", ".join(list(changes)[:3])
        seen_there = f"{keys}, written in a way that cannot be edited"
        how = "[[patch]] and [[ring]] on lines of their own"
        raise ConfigError.of(path, "file", seen_there, how)
    return edited


def write_arm(path: Path, target: Path, changes: Mapping[str, Change]) -> None:
    """Write an arm file with other values in its patches in the place of ``target``, if it makes an arm.

    Raises:
        ConfigError: it does not, or cannot be edited: boards would lie on each other, or beyond their link.
    """
    edited = edit_arm(path, read_bytes(path, MAX_BYTES).decode(), changes)
    try:
        make_arm(check_tables(tomllib.loads(edited), target), check_load=False)
    except ConfigError as error:
        raise ConfigError(f"{target}, as it would be", error.faults) from None
    write_whole(target, edited.encode(), target.stat().st_mode & 0o777 if target.exists() else 0o644)


def _as_patches(lines: list[str], boards: list[dict[str, Any]]) -> list[str]:
    """Return the tables of boards, after the comments that stand on lines of their own."""
    out = [line for line in lines if line.lstrip().startswith("#")]
    for board in boards:
        out += ["[[patch]]", *(f"{key} = {_spell(value)}" for key, value in board.items()), ""]
    return out[:-1]


def _boards(kind: str, name: str, table: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the boards of a table as tables of patches, by their keys."""
    if kind == "patch":
        return {name: table}
    boards = RingTable.model_validate(table).boards()
    return {f"{name}#{k}": board.model_dump(exclude_unset=True) for k, board in enumerate(boards, 1)}


def _filled(document: dict[str, Any]) -> dict[str, Any]:
    """Return a document without empty lists of tables."""
    return {key: value for key, value in document.items() if value}


def _spell(value: Any) -> str:
    """Return a value as TOML: but for tables, it is as JSON has it."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_spell(str(key))} = {_spell(own)}" for key, own in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
