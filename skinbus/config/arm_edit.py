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
    wanted = _changed(tomllib.loads(text), changes)
    crlf = "\r\n" in text
    lines = text.replace("\r\n", "\n").splitlines()
    matches = ((k, _HEADER.match(line)) for k, line in enumerate(lines))
    heads = [(k, str(found[1]), str(found[2])) for k, found in matches if found]
    heads.append((len(lines), "[", ""))
    rings = _ring_boards(tomllib.loads(text), changes)
    numbers: Counter[str] = Counter()
    out, done = [], 0
    for i, (first, bracket, kind) in enumerate(heads):
        if bracket != "[[" or kind not in ("patch", "ring"):
            continue
        numbers[kind] += 1
        name = f"{kind}[{numbers[kind]}]"
        own = _until_blank(lines, first, heads[i + 1][0])  # its keys, without those of tables in it
        others = (k for k, _, inner in heads[i + 1 :] if not inner.startswith(f"{kind}."))
        last = _until_blank(lines, first, next(others))
        if name in rings:
            out += lines[done:first] + _as_patches(lines[first:last], rings[name])
            done = last
        elif name in changes:
            out += lines[done:first] + _edited(lines[first:own], changes[name])
            done = own
    out += lines[done:]
    edited = "\n".join(out) + "\n"
    try:
        is_good = _alike(tomllib.loads(edited)) == _alike(wanted)
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


def _ring_boards(document: dict[str, Any], changes: Mapping[str, Change]) -> dict[str, list[dict[str, Any]]]:
    """Return the boards of each ring that changes, as tables of patches, by the key of the ring."""
    found = {}
    for number, ring in enumerate(document.get("ring", []), 1):
        name = f"ring[{number}]"
        if not any(key.startswith(f"{name}#") for key in changes):
            continue
        shared = {key: ring[key] for key in _SHARED if key in ring}
        boards = []
        for k in range(ring["count"]):
            angle_deg = ring.get("angle_deg", 0.0) + 360.0 * k / ring["count"]
            own = {"node_id": ring["first_node_id"] + k, "angle_deg": round(angle_deg, _DIGITS)}
            if "eds" in ring:
                own["eds"] = ring["eds"][k] if isinstance(ring["eds"], list) else ring["eds"]
            boards.append(_with({**own, **shared}, changes.get(f"{name}#{k + 1}", {})))
        found[name] = boards
    return found


def _changed(document: dict[str, Any], changes: Mapping[str, Change]) -> dict[str, Any]:
    """Return a document with other values in its patches."""
    rings = _ring_boards(document, changes)
    patches = [
        _with(table, changes.get(f"patch[{k}]", {})) for k, table in enumerate(document.get("patch", []), 1)
    ]
    patches += [board for boards in rings.values() for board in boards]
    left = [ring for k, ring in enumerate(document.get("ring", []), 1) if f"ring[{k}]" not in rings]
    return {**document, "patch": patches, "ring": left}


def _with(table: dict[str, Any], change: Change) -> dict[str, Any]:
    """Return a table with other values."""
    values = {**table, **{key: _rounded(value) for key, value in change.items()}}
    return {key: value for key, value in values.items() if value is not None}


def _alike(document: dict[str, Any]) -> dict[str, Any]:
    """Return a document in which the order of patches does not matter."""
    patches = sorted(json.dumps(table, sort_keys=True, default=str) for table in document.get("patch", []))
    return {**document, "patch": patches, "ring": document.get("ring", [])}


def _rounded(value: Any) -> Any:
    return round(value, _DIGITS) + 0.0 if isinstance(value, float) else value


def _spell(value: Any) -> str:
    """Return a value as TOML: but for tables, it is as JSON has it."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_spell(str(key))} = {_spell(own)}" for key, own in value.items()) + " }"
    return json.dumps(_rounded(value), ensure_ascii=False).replace("\x7f", "\\u007f")
