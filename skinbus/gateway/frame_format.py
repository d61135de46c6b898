"""The frames of a skin that is not CANopen, as a file says them: identifiers, fields, readings, commands.

Patterns are written in bits, most significant first. ``0`` and ``1`` are fixed; the bits of one letter are a
number. Eleven bits are an identifier. Each byte of data is eight bits or two hexadecimal digits.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import ConfigDict, Field, with_config

from skinbus.arrays import Ints, Ints32
from skinbus.can.fd import CLASSIC_BYTES
from skinbus.config.parameters import read
from skinbus.config.toml_file import find_toml, names_in, read_toml
from skinbus.errors import ArgumentError, ConfigError, FaultList
from skinbus.model.patch import MAX_TACTELS

FORMATS = Path(__file__).parent / "formats"
"""The formats that travel with the package."""

ID_BITS = 11

Type = Literal["u1", "i1", "<u2", ">u2", "<i2", ">i2"]
"""Of a number in data, as in numpy: kind and bytes, ``>`` with the most significant byte first."""
Letter = Annotated[str, Field(pattern="^[a-z]$")]
Byte = Annotated[int, Field(ge=0, le=7)]
Tactels = Annotated[list[Annotated[int, Field(ge=-1, lt=MAX_TACTELS)]], Field(min_length=1, max_length=16)]
"""Which tactel each number or bit is of; -1 for none."""
IdPattern = Annotated[str, Field(pattern=f"^[01a-z]{{{ID_BITS}}}$")]
DataPattern = Annotated[str, Field(pattern=r"^(([01a-z]{8}|[0-9A-F]{2})( |$)){0,8}$")]
_STRICT = ConfigDict(extra="forbid")


@with_config(_STRICT)
@dataclass(frozen=True)
class Unhealthy:
    """A number in data with a bit for each tactel that does not work.

    Args:
        byte: where it starts.
        bits: the tactel of each bit, least significant first.
        type: of the number.
    """

    byte: Byte
    bits: Tactels
    type: Type = "u1"


@with_config(_STRICT)
@dataclass(frozen=True)
class BoardFault:
    """A bit in data that says that no reading of the patch is good."""

    byte: Byte
    bit: Byte
    text: str


@with_config(_STRICT)
@dataclass(frozen=True)
class FrameTable:
    """``[[frame]]``: a frame with readings.

    Args:
        id: pattern of the identifier.
        tactels: the tactel of each reading, counted from the offset of the letters.
        data: pattern of the first bytes; none by default.
        byte: where the readings start.
        unhealthy: tactels that do not work.
        faults: bits that condemn all readings of the patch.
    """

    id: IdPattern
    tactels: Tactels
    data: DataPattern = ""
    byte: Byte = 0
    unhealthy: Unhealthy | None = None
    faults: list[BoardFault] = field(default_factory=list)


@with_config(_STRICT)
@dataclass(frozen=True)
class CommandTable:
    """``[[start]]``, ``[[stop]]``, ``[[poll]]``: a frame to the boards; its letters are of the address."""

    id: IdPattern
    data: DataPattern = ""


@with_config(_STRICT)
@dataclass(frozen=True)
class FrameFormat:
    """What the frames of a skin look like.

    Args:
        title: what skin it is.
        source: where its frames are described.
        bitrate: bit/s.
        period_ms: how often a board sends all its readings.
        n_tactels: of each patch.
        zero: reading that makes 0 counts.
        gain: counts by which one step of a reading counts; full scale is 32767.
        type: of a reading.
        frame: those with readings.
        address: name of each letter that says which patch sends; an address is their numbers, with dots.
        offset: by how many tactels one step of a letter shifts the readings of a frame.
        start, stop: commands, in their order.
        poll: commands that are repeated every period.
    """

    title: str
    source: str
    bitrate: Annotated[int, Field(ge=10_000, le=1_000_000)]
    period_ms: Annotated[float, Field(ge=1.0, le=1000.0)]
    n_tactels: Annotated[int, Field(ge=1, le=MAX_TACTELS)]
    zero: Annotated[float, Field(ge=-65536.0, le=65536.0)]
    gain: Annotated[float, Field(ge=-32767.0, le=32767.0)]
    frame: Annotated[list[FrameTable], Field(min_length=1, max_length=64)]
    type: Type = "u1"
    address: dict[Letter, str] = field(default_factory=dict)
    offset: dict[Letter, Annotated[int, Field(ge=1, le=MAX_TACTELS)]] = field(default_factory=dict)
    start: list[CommandTable] = field(default_factory=list)
    stop: list[CommandTable] = field(default_factory=list)
    poll: list[CommandTable] = field(default_factory=list)

    def numbers(self, address: str) -> dict[str, int]:
        """Return the number of each letter of an address.

        Raises:
            ArgumentError: it is none of this format.
        """
        parts = address.split(".") if self.address else []
        if len(parts) != len(self.address) or not all(re.fullmatch("[0-9]{1,4}", part) for part in parts):
            form = ".".join(self.address.values()) or "empty"
            raise ArgumentError(f"address {address!r}: wanted {form}, in numbers")
        numbers = dict(zip(self.address, map(int, parts), strict=True))
        for letter, number in numbers.items():
            width = max(_bits(table.id + table.data).count(letter) for table in self.frame)
            if number >> width:
                raise ArgumentError(
                    f"address {address!r}: wanted a {self.address[letter]} up to {(1 << width) - 1}"
                )
        return numbers

    def length(self, table: FrameTable) -> int:
        """Return the bytes of a frame that are read."""
        ends = [table.byte + np.dtype(self.type).itemsize * len(table.tactels)]
        if table.unhealthy:
            ends.append(table.unhealthy.byte + np.dtype(table.unhealthy.type).itemsize)
        return max([*ends, *(fault.byte + 1 for fault in table.faults)])

    def parts(self, address: str) -> list[Part]:
        """Return what of the readings of a patch comes in which frame."""
        numbers = self.numbers(address)
        found = []
        for table in self.frame:
            bits = _bits(table.id + table.data)
            letters = [letter for letter in self.offset if letter in bits]
            for steps in product(*(self._steps(letter, bits.count(letter)) for letter in letters)):
                values = dict(zip(letters, steps, strict=True))
                shift = sum(self.offset[letter] * step for letter, step in values.items())
                to = np.array(table.tactels)
                to[to >= 0] += shift
                if to.max() < self.n_tactels:
                    can_id, data = _fill(table, numbers | values)
                    found.append(Part(can_id, data, self.length(table), to, table))
        return found

    def _steps(self, letter: str, width: int) -> range:
        """Return the values of a letter of so many bits, until its tactels are those of a larger step."""
        own = self.offset[letter]
        larger = min((step for step in self.offset.values() if step > own), default=own << width)
        return range(min(1 << width, -(-larger // own)))

    def commands(self, tables: Sequence[CommandTable], addresses: Sequence[str]) -> list[tuple[int, bytes]]:
        """Return identifiers and data of commands to the boards of some patches, each once."""
        every = [_fill(table, self.numbers(address)) for table in tables for address in addresses]
        return list(dict.fromkeys(every))

    def counts(self, raw: npt.NDArray[Any]) -> Ints32:
        """Return the counts (n,) of readings (n,); the last one that its type has is at full scale."""
        counts = np.clip(np.rint((raw - self.zero) * self.gain), -0x8000, 0x7FFF)
        limits = np.iinfo(self.type)
        counts[raw == (limits.max if self.gain > 0.0 else limits.min)] = 0x7FFF
        return counts.astype(np.int32)


@dataclass(frozen=True)
class Part:
    """Readings of a patch that come in one frame.

    Args:
        can_id: identifier of the frame.
        data: its first bytes.
        length: bytes that it has at least.
        to: (n,) the tactel of each reading; -1 for none.
        table: where the readings are.
    """

    can_id: int
    data: bytes
    length: int
    to: Ints
    table: FrameTable

    def unhealthy(self, data: bytes) -> list[int]:
        """Return the tactels that do not work, as the data of the frame says."""
        where = self.table.unhealthy
        if where is None:
            return []
        number = int(np.frombuffer(data, where.type, 1, where.byte)[0])
        return [tactel for bit, tactel in enumerate(where.bits) if tactel >= 0 and number >> bit & 1]

    def faults(self, data: bytes) -> list[str]:
        """Return why no reading of the patch is good, as the data of the frame says."""
        return [fault.text for fault in self.table.faults if data[fault.byte] >> fault.bit & 1]


def format_names() -> list[str]:
    """Return the names of the formats that travel with the package."""
    return names_in(FORMATS)


def load_format(name_or_path: str | Path) -> FrameFormat:
    """Return the format of a TOML file, or one that travels with the package, by name.

    Raises:
        ConfigError: every fault of the file.
    """
    path = find_toml(name_or_path, FORMATS, "format")
    faults = FaultList()
    found = read(FrameFormat, read_toml(path), "format", faults)
    if found is not None:
        faults += _faults(found)
    if found is None or faults:
        raise ConfigError(str(name_or_path), faults)
    return found


def _faults(found: FrameFormat) -> FaultList:
    """Return what fits no pattern or no frame."""
    faults = FaultList()
    address = set(found.address)
    tables: dict[str, Sequence[FrameTable | CommandTable]] = {
        "frame": found.frame,
        "start": found.start,
        "stop": found.stop,
        "poll": found.poll,
    }
    for key, i, table in ((key, i, table) for key, each in tables.items() for i, table in enumerate(each, 1)):
        used = set(re.findall("[a-z]", table.id + table.data))
        known = address | set(found.offset) if key == "frame" else address
        if used - known:
            wanted = f"letters of {', '.join(sorted(known)) or 'none'}"
            faults.add(f"{key} {i}", ", ".join(sorted(used - known)), wanted)
        if isinstance(table, FrameTable):
            if missing := ", ".join(sorted(address - used)):
                faults.add(f"frame {i}", None, f"the letters {missing} of the address")
            if (length := found.length(table)) > CLASSIC_BYTES:
                faults.add(f"frame {i}", length, f"readings within {CLASSIC_BYTES} bytes")
    if not faults:
        parts = found.parts(".".join("0" for _ in found.address))
        sent = sorted(tactel for part in parts for tactel in part.to if tactel >= 0)
        if sent != list(range(found.n_tactels)):
            wanted = f"frames that carry each of {found.n_tactels} tactels once"
            faults.add("frame", None, wanted)
    return faults


def _bits(pattern: str) -> str:
    """Return a pattern with its hexadecimal bytes in bits; the identifier's 11 come first."""
    rest = re.sub(r"(?<![01a-z])([0-9A-F]{2})(?![01a-z])", lambda byte: f"{int(byte[1], 16):08b}", pattern)
    return rest.replace(" ", "")


def _fill(table: FrameTable | CommandTable, numbers: Mapping[str, int]) -> tuple[int, bytes]:
    """Return identifier and first bytes of a frame whose letters have these numbers."""
    bits = table.id + _bits(table.data)
    for letter, number in numbers.items():
        width = bits.count(letter)
        places = iter(f"{number:0{width}b}")
        bits = "".join(next(places) if bit == letter else bit for bit in bits)
    data = bits[ID_BITS:]
    return int(bits[:ID_BITS], 2), bytes(int(data[i : i + 8], 2) for i in range(0, len(data), 8))
