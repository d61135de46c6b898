"""What pydantic finds wrong in a table, in our words: one fault for each key, with the nearest known key."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from difflib import get_close_matches
from typing import Any

from skinbus.errors import Fault, FaultList

_OF_TYPES = re.compile(
    r"(float|int|str|bool|list|tuple|dict|\[key\])|(constrained|function|nullable)-.*|.*\[.+\]"
)
"""Parts of a place that name a branch of a type, not a key."""

_WORDS = (
    (r"(Input|Tuple|List|Dictionary|String|Value) should (be|have|contain) ", ""),
    (r"^Value error, ", ""),
    (r"a valid number.*", "a number"),
    (r"a valid integer.*", "a whole number"),
    (r"a valid string", "a text"),
    (r"a valid boolean.*", "true or false"),
    (r"a valid (list|tuple|array)", "an array"),
    (r"(a valid dictionary( or instance of \w+)?|an object|a dictionary or an instance of \w+)", "a table"),
    (r" after validation, not \d+", ""),
    (r"String should match pattern '(.*)'", r"a text of the pattern \1"),
)

_AS_A_COLUMN = 0.45
"""Likeness from which a name may be meant for a column that is missing: `s` for `s_mm` has 0.5."""
_MISSPELT = 0.75
"""Likeness from which a name is that of a column which nobody misses: `force` for `force_n` has 0.9."""
_ABSENT = ("missing", "missing_argument", "missing_keyword_only_argument")
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")


def faults_of(
    details: Iterable[Any], key: str, known: Sequence[str], inner: Sequence[str] = ()
) -> list[Fault]:
    """Return the faults of a table that pydantic refused.

    known: the keys that it may have
    inner: the keys that a table in it may have
    """
    found: dict[str, Fault] = {}
    for detail in details:
        where = key
        for depth, part in enumerate(detail["loc"]):
            if isinstance(part, int):
                where += f"[{part + 1}]"
            elif not depth or not _OF_TYPES.fullmatch(part):
                where += f".{part}"
        wanted = _wanted(detail, inner if detail["loc"][1:] else known)
        seen = None if detail["type"] in _ABSENT else detail["input"]
        before = found.setdefault(where, Fault(where, seen, wanted))
        if wanted not in (
            before.wanted,
            *before.wanted.split(", or "),
        ):  # another branch of what the key may be
            found[where] = replace(before, wanted=f"{before.wanted}, or {wanted}")
    return list(found.values())


def nearest(word: str, known: Sequence[str]) -> str:
    """Return ``; did you mean X?`` where a known word is near, else nothing.

    A key that ends with a unit of known keys, as ``_s`` does, is not near to one without a unit.
    """
    units = {name.rpartition("_")[2] for name in known if "_" in name}
    if "_" in word and word.rpartition("_")[2] in units:
        known = [name for name in known if "_" in name]
    near = get_close_matches(word, known, n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def header_faults(
    names: Sequence[str], choices: Sequence[Sequence[str]], optional: Sequence[str]
) -> FaultList:
    """Return what is wrong in the header of a table: needed columns that are not there, and misspelt ones.

    names:    of its columns
    choices:  columns of which those of one choice are needed; the nearest one is held against the table
    optional: columns that nobody misses; a name that is nearly one of them is a fault, others are not
    """
    faults = FaultList()
    if len(names) == 1 and (other := re.search(r"[;\t|]", names[0])):
        faults.add("line 1", f"divided by {other[0]!r}", "commas between columns, and points in numbers")
        return faults
    alike = {_plain(name) for name in names}
    needed = min(choices, key=lambda choice: len({*map(_plain, choice)} - alike))
    known = (*needed, *optional)
    left = {_plain(name): name for name in names if name not in known}
    for column in known:
        n = names.count(column)
        cutoff = _MISSPELT if column in optional else _AS_A_COLUMN
        near = get_close_matches(_plain(column), [*left], n=1, cutoff=cutoff) if n == 0 else []
        if n > 1:
            faults.add("line 1", f"{n} columns {column!r}", "each column once")
        elif near or (n == 0 and column in needed):
            seen = left.pop(near[0]) if near else None
            faults.add("line 1", seen, f"a column {column!r}, of {', '.join(needed)}")
    return faults


def _plain(column: str) -> str:
    """Return the name of a column without what people write differently: s [mm] is s_mm."""
    return re.sub(r"[^a-z0-9]", "", column.lower())


def _wanted(detail: Any, known: Sequence[str]) -> str:
    if detail["type"] in _UNKNOWN:
        hint = nearest(str(detail["loc"][-1]), known)
        return "no such key" + (hint or f"; known are {', '.join(known) or 'none'}")
    if detail["type"] in _ABSENT:
        return "a value; it has no default"
    message = str(detail["msg"])
    for pattern, word in _WORDS:
        message = re.sub(pattern, word, message)
    return message
