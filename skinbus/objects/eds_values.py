"""Data types of CiA 301 and their values: text of an EDS to number, number to bytes, and back.

Source: CiA 301, 7.1.4 and 7.4.7 (data types); CiA 306-1, 4.5 (spelling of values).
"""

from __future__ import annotations

import math
import re
import struct
from typing import NamedTuple

BOOLEAN = 0x01
INTEGER16 = 0x03
UNSIGNED8 = 0x05
UNSIGNED16 = 0x06
UNSIGNED32 = 0x07
REAL32 = 0x08
VISIBLE_STRING = 0x09
OCTET_STRING = 0x0A
UNICODE_STRING = 0x0B
DOMAIN_TYPE = 0x0F
REAL64 = 0x11


class DataType(NamedTuple):
    """A data type: its length on the wire and, for integers, its range."""

    name: str
    bits: int
    """0 for strings and domains, which have no fixed length."""
    low: int = 0
    high: int = 0
    """Range of an integer; both 0 for all else."""

    @property
    def is_integer(self) -> bool:
        """True for BOOLEAN, INTEGERn and UNSIGNEDn."""
        return self.high > 0


_SIGNED = {2: 8, 3: 16, 4: 32, 0x10: 24, 0x12: 40, 0x13: 48, 0x14: 56, 0x15: 64}
_UNSIGNED = {5: 8, 6: 16, 7: 32, 0x16: 24, 0x18: 40, 0x19: 48, 0x1A: 56, 0x1B: 64}
"""Bits of the integers."""


TYPES: dict[int, DataType] = {
    BOOLEAN: DataType("BOOLEAN", 1, 0, 1),
    **{t: DataType(f"INTEGER{n}", n, -(1 << (n - 1)), (1 << (n - 1)) - 1) for t, n in _SIGNED.items()},
    **{t: DataType(f"UNSIGNED{n}", n, 0, (1 << n) - 1) for t, n in _UNSIGNED.items()},
    REAL32: DataType("REAL32", 32),
    REAL64: DataType("REAL64", 64),
    VISIBLE_STRING: DataType("VISIBLE_STRING", 0),
    OCTET_STRING: DataType("OCTET_STRING", 0),
    UNICODE_STRING: DataType("UNICODE_STRING", 0),
    0x0C: DataType("TIME_OF_DAY", 48),
    0x0D: DataType("TIME_DIFFERENCE", 48),
    DOMAIN_TYPE: DataType("DOMAIN", 0),
}

Number = int | float | str | bytes


class Value(NamedTuple):
    """A value as a file gives it; ``relative`` ones have the node-ID added to them."""

    number: Number
    relative: bool = False


MAX_DIGITS = 100
"""Of an integer; 64 bits have 22 in the longest spelling."""

_INTEGER = re.compile(r"[+-]?(?:0x[0-9a-f]+|0[0-7]*|[1-9][0-9]*)", re.IGNORECASE)
_RELATIVE = re.compile(r"\$nodeid(?:\+(.+))?|(.+)\+\$nodeid", re.IGNORECASE)


def parse_integer(text: str) -> int | None:
    """Return a decimal, hexadecimal (0x) or octal (leading 0) integer; None for anything else."""
    text = text.partition(";")[0].strip()
    if len(text) > MAX_DIGITS or not _INTEGER.fullmatch(text):
        return None
    digits = text.lstrip("+-")
    base = 16 if digits[:2] in ("0x", "0X") else 8 if digits[0] == "0" else 10
    number = int(digits, base)
    return -number if text[0] == "-" else number


def parse_value(text: str, data_type: int) -> Value | str:
    """Return the value that ``text`` spells in a data type, or, as text, what was wanted instead."""
    kind = TYPES[data_type]
    if kind.is_integer:
        return _parse_integer_value(text, kind)
    if data_type in (REAL32, REAL64):
        return _parse_real(text, kind.bits)
    if data_type in (OCTET_STRING, DOMAIN_TYPE):
        try:
            return Value(bytes.fromhex(text))
        except ValueError:
            return "pairs of hexadecimal digits"
    if data_type in (VISIBLE_STRING, UNICODE_STRING):
        return Value(text)
    return f"no value for {kind.name}"


def _parse_integer_value(text: str, kind: DataType) -> Value | str:
    spelled = re.sub(r"\s+", "", text.partition(";")[0])
    relative = "$nodeid" in spelled.lower()
    if relative:
        match = _RELATIVE.fullmatch(spelled)
        if match is None:
            return "$NODEID or $NODEID+number"
        spelled = match[1] or match[2] or "0"
    number = parse_integer(spelled)
    if number is None:
        return f"{kind.name}: 10, 0x0A or 012, or $NODEID+number"
    if spelled[:2].lower() == "0x" and kind.low < 0 and kind.high < number < 1 << kind.bits:
        number -= 1 << kind.bits  # a negative number spelled as its bits
    if not kind.low <= number <= kind.high - (127 if relative and kind.high >= 127 else 0):
        return f"{kind.name}: {kind.low} to {kind.high}"
    return Value(number, relative)


def _parse_real(text: str, bits: int) -> Value | str:
    """Return a real number; hexadecimal spells its IEEE 754 bits (as dcf-tools and lely read it)."""
    text = text.partition(";")[0].strip()
    wanted = f"a real number, or its {bits} bits in hexadecimal"
    if text[:2].lower() == "0x":
        number = parse_integer(text)
        if number is None or number >= 1 << bits:
            return wanted
        (real,) = struct.unpack("<f" if bits == 32 else "<d", number.to_bytes(bits // 8, "little"))
    else:
        try:
            real = float(text)
        except ValueError:
            return wanted
    return Value(real) if math.isfinite(real) else "a finite number"


def encode(number: Number, data_type: int) -> bytes:
    """Return the bytes of a value on the wire, little-endian.

    Raises:
        ValueError: the value does not fit the data type.
    """
    kind = TYPES[data_type]
    if isinstance(number, bytes | bytearray):
        return bytes(number)
    if isinstance(number, str):
        if data_type not in (VISIBLE_STRING, UNICODE_STRING):
            raise ValueError(f"{number!r} does not fit {kind.name}")
        return number.encode("utf-16-le" if data_type == UNICODE_STRING else "latin-1", errors="replace")
    if data_type in (REAL32, REAL64):
        return struct.pack("<f" if data_type == REAL32 else "<d", float(number))
    if not kind.low <= number <= kind.high or int(number) != number:  # false for NaN and what is no integer
        raise ValueError(f"{number!r} does not fit {kind.name}")
    return int(number).to_bytes((kind.bits + 7) // 8, "little", signed=kind.low < 0)
