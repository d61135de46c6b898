"""Text from outside as a terminal and a log can take it: control characters are escaped, length is bounded.

Names in boards (0x1008), arm files, recordings and paths are anybody's: an escape code in one would retitle,
clear or forge what an operator reads.
"""

from __future__ import annotations

import reprlib
from typing import Any

MAX_TEXT = 200
"""Characters of one text from outside that are shown: two lines of a terminal."""

_MAX_INTEGER_BITS = 256
"""Longer integers are named by their length: Python refuses to print those of more than 4300 digits."""


def printable(text: object, *, keep: str = "", limit: int | None = MAX_TEXT) -> str:
    r"""Return text whose control, format and separator characters are escaped as in Python (``\x1b``).

    Args:
        keep: characters that stay, such as the line feeds of our own messages.
        limit: most characters of ``text``; None for all of them.
    """
    whole = str(text)
    shown = whole if limit is None or len(whole) <= limit else whole[:limit] + "..."
    if shown.isprintable():
        return shown
    return "".join(c if c.isprintable() or c in keep else ascii(c)[1:-1] for c in shown)


def layout(text: object) -> str:
    """Return a message of ours, which may quote others: all of it, its line feeds and tabs kept."""
    return printable(text, keep="\n\t", limit=None)


class _Values(reprlib.Repr):
    """``repr`` within bounds of depth, length and digits."""

    def repr_int(self, x: int, level: int) -> str:
        if x.bit_length() > _MAX_INTEGER_BITS:
            return f"an integer of {x.bit_length()} bits"
        return super().repr_int(x, level)


_VALUES = _Values()
_VALUES.maxlevel, _VALUES.maxdict, _VALUES.maxlist, _VALUES.maxtuple = 3, 4, 6, 6
_VALUES.maxstring = _VALUES.maxother = MAX_TEXT
_VALUES.maxlong = 80


def shown_value(value: Any) -> str:
    """Return ``repr(value)``, escaped, within bounds of depth, length and digits."""
    return printable(_VALUES.repr(value))
