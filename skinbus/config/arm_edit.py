"""Edits of an arm file: values of its patches change, everything else stays as it was written, with comments.

Lines are replaced, no document is written anew: a ring whose boards are no longer alike becomes patches
where it stood. What comes out is parsed and compared with what was wanted, so a file that is written in a way
that is not foreseen here is refused, never spoilt.
"""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from skinbus.config.system import load_arm
from skinbus.config.toml_file import MAX_BYTES
from skinbus.errors import ConfigError, Fault
from skinbus.file_bytes import read_bytes, write_whole

Change = Mapping[str, Any]
"""New values by key; None takes a key out."""

_HEADER: Final = re.compile(r"\s*(\[\[?)\s*([\w.-]+)\s*\]\]?\s*(?:#.*)?$")
_KEY: Final = re.compile(r"""(\s*)([\w-]+)\s*=\s*("(?:[^"\\]|\\.)*"|'[^']*'|[^#]*?)\s*(?:#.*)?$""")
_SHARED: Final = ("link", "s_mm", "yaw_deg", "mirrored", "bus", "set")
"""Keys that the boards of a ring have in common."""
_DIGITS: Final = 6
"""Decimals of a millimetre or a degree: nanometres."""


def edit_arm(path: Path, text: str, changes: Mapping[str, Change]) -> str:
    """Return the text of an arm file with other values in its patches.

    changes: by the key of a patch as ``Mounting.key`` has it, ``patch[2]`` or ``ring[1]#3``.

    Raises:
        ConfigError: a table is written in a way that cannot be edited: keys in quotes, tables in one line.
    """
    document = tomllib.loads(text)
    changes = {name: {key: _rounded(v) for key, v in change.items()} for name, change in changes.items()}
    crlf = "\r\n" in text
    lines = text.replace("\r\n", "\n").splitlines()
    matches = ((k, _HEADER.match(line)) for k, line in enumerate(lines))
    heads = [(k, str(found[1]), str(found[2])) for k, found in matches if found]
    heads.append((len(lines), "[", ""))
    left = {kind: iter(document.get(kind, [])) for kind in ("patch", "ring")}
    wanted: dict[str, list[Any]] = {kind: [] for kind in left}
    numbers: Counter[str] = Counter()
    out, done = [], 0
    for i, (first, bracket, kind) in enumerate(heads):
        if bracket != "[[" or kind not in wanted:
            continue
        numbers[kind] += 1
        name = f"{kind}[{numbers[kind]}]"
        table: dict[str, Any] = next(left[kind], {})
        if any(key.startswith(f"{name}#") for key in changes):
            boards = [
                _with(board, changes.get(f"{name}#{k}", {})) for k, board in enumerate(_boards(table), 1)
            ]
            wanted["patch"] += boards
            others = (k for k, _, inner in heads[i + 1 :] if not inner.startswith(f"{kind}."))
            last = _until_blank(lines, first, next(others))
            out += lines[done:first] + _as_patches(lines[first:last], boards)
        else:
            change = changes.get(name, {})
            wanted[kind].append(_with(table, change))
            last = _until_blank(lines, first, heads[i + 1][0])  # without tables in it
            out += lines[done:first] + _edited(lines[first:last], change)
        done = last
    edited = "\n".join(out + lines[done:]) + "\n"
    try:
        is_good = _filled(tomllib.loads(edited)) == _filled({**document, **wanted})
    except tomllib.TOMLDecodeError:
        is_good = False
    if not is_good:
        keys = ", ".join(list(changes)[:3])
        seen = f"{keys}, written in a way that cannot be edited"
        how = "one line for each value of a [[patch]] or [[ring]]"
        raise ConfigError(str(path), [Fault("file", seen, how)])
    return edited.replace("\n", "\r\n") if crlf else edited


def write_arm(path: Path, target: Path, changes: Mapping[str, Change]) -> None:
    """Write an arm file with other values in its patches in the place of ``target``, if it makes an arm.

    Raises:
        ConfigError: it does not, or cannot be edited: boards would lie on each other, or beyond their link.
    """
    edited = edit_arm(path, read_bytes(path, MAX_BYTES).decode(), changes)
    trial = target.with_name(f".{target.stem}.{os.getpid()}.trial.toml")
    try:
        write_text(trial, edited)
        load_arm(trial, check_load=False)
    except ConfigError as error:
        raise ConfigError(f"{target}, as it would be", error.faults) from None
    finally:
        trial.unlink(missing_ok=True)
    write_text(target, edited)


def write_text(path: Path, text: str) -> None:
    """Put a text in the place of a file: all of it or nothing, whatever ends the program."""
    mode = path.stat().st_mode & 0o777 if path.exists() else 0o644
    write_whole(path, text.encode(), mode)


def _until_blank(lines: list[str], first: int, end: int) -> int:
    """Return the end of a table without the comments and empty lines before the next one."""
    while end > first and not lines[end - 1].partition("#")[0].strip():
        end -= 1
    return end


def _edited(lines: list[str], change: Change) -> list[str]:
    """Return the lines of a table with other values; keys that it does not have come last."""
    left = dict(change)
    out: list[str] = []
    indent = ""
    for line in lines:
        found = _KEY.match(line)
        if found:
            indent = found[1]
        if not found or found[2] not in left:
            out.append(line)
            continue
        value = left.pop(found[2])
        if value is not None:
            out.append(line[: found.start(3)] + _spell(value) + line[found.end(3) :])
    return out + [f"{indent}{key} = {_spell(value)}" for key, value in left.items() if value is not None]


def _as_patches(lines: list[str], boards: list[dict[str, Any]]) -> list[str]:
    """Return the tables of the boards of a ring, after the comments that stand in it."""
    out = [line for line in lines if line.lstrip().startswith("#")]
    for board in boards:
        out += ["[[patch]]", *(f"{key} = {_spell(value)}" for key, value in board.items()), ""]
    return out[:-1]


def _boards(ring: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the boards of a ring as tables of patches."""
    shared = {key: ring[key] for key in _SHARED if key in ring}
    boards = []
    for k in range(ring["count"]):
        angle_deg = _rounded(ring.get("angle_deg", 0.0) + 360.0 * k / ring["count"])
        own = {"node_id": ring["first_node_id"] + k, "angle_deg": angle_deg}
        if "eds" in ring:
            own["eds"] = ring["eds"][k] if isinstance(ring["eds"], list) else ring["eds"]
        boards.append(own | shared)
    return boards


def _with(table: dict[str, Any], change: Change) -> dict[str, Any]:
    """Return a table with other values."""
    return {key: value for key, value in {**table, **change}.items() if value is not None}


def _filled(document: dict[str, Any]) -> dict[str, Any]:
    """Return a document without empty lists of tables."""
    return {key: value for key, value in document.items() if value}


def _rounded(value: Any) -> Any:
    return round(value, _DIGITS) + 0.0 if isinstance(value, float) else value


def _spell(value: Any) -> str:
    """Return a value as TOML: but for tables, it is as JSON has it."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_spell(str(key))} = {_spell(own)}" for key, own in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
