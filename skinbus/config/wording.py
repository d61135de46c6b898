"""What pydantic finds wrong in a table, in our words: one fault for each key, with the nearest known key."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any, Final

from skinbus.errors import Fault

_OF_TYPES: Final = re.compile(
    r"(float|int|str|bool|list|tuple|dict|\[key\])|(constrained|function|nullable)-.*|.*\[.+\]"
)
"""Parts of a place that name a branch of a type, not a key."""

_WORDS: Final = (
    (r"(Input|Tuple|List|Dictionary|String|Value) should (be|have|contain) ", ""),
    (r"^Value error, ", ""),
    (r"a valid number.*", "a number"),
    (r"a valid integer.*", "a whole number"),
    (r"a valid string", "a text"),
    (r"a valid boolean.*", "true or false"),
    (r"a valid (list|tuple|array)", "an array"),
    (r"(a valid dictionary|an object|a dictionary or an instance of \w+)", "a table"),
    (r" after validation, not \d+", ""),
    (r"String should match pattern '(.*)'", r"a text of the pattern \1"),
)

_ABSENT: Final = ("missing", "missing_argument", "missing_keyword_only_argument")
_UNKNOWN: Final = ("extra_forbidden", "unexpected_keyword_argument")


def faults_of(details: Iterable[Any], key: str, known: Sequence[str]) -> list[Fault]:
    """Return the faults of a table that pydantic refused; ``known`` are the keys that it may have."""
    found: dict[str, Fault] = {}
    for detail in details:
        where = key
        for depth, part in enumerate(detail["loc"]):
            if isinstance(part, int):
                where += f"[{part + 1}]"
            elif not depth or not _OF_TYPES.fullmatch(part):
                where += f".{part}"
        seen, wanted = detail["input"], _wanted(detail, known)
        if detail["type"] in _ABSENT:
            seen = None
        before = found.get(where)
        if before is None:
            found[where] = Fault(where, seen, wanted)
        elif wanted not in before.wanted.split(", or "):  # another branch of what the key may be
            found[where] = Fault(where, before.seen, f"{before.wanted}, or {wanted}")
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
