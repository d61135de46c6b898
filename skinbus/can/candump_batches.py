"""Recordings as columns: whole blocks of candump text to batches of frames, for those who need every frame.

Lines as ``candump -L`` and ``skinbus record`` write them are parsed by a kernel; every other line is given to
:func:`parse_line`, in its turn, so that both readers agree on what a frame is.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from skinbus.can.candump import LONGEST_LINE, MAX_STRANGE, CandumpReader
from skinbus.can.frame import BRS, ERROR, ESI, EXTENDED, FD, MAX_DATA, Frame, FrameBatch
from skinbus.errors import ConfigError, Fault
from skinbus.jit import inner_kernel, kernel

BLOCK: Final = 1 << 22
"""Bytes read at a time: some 100 000 lines, beside which the calls of a block take no time."""

CAPACITY: Final = 1 << 16
"""Frames of a batch at most: 5 MB."""

MAX_CHANNELS: Final = 255
"""Interfaces in a recording: their number is the ``bus`` of a frame, a byte."""

_LONGEST_NAME: Final = 16
"""Bytes of a name of an interface that the kernel compares: IFNAMSIZ; longer ones take the slow way."""

_LAST_NS: Final = 9_223_372_036_000_000_000
"""In 2262; times after it do not fit 64 bits."""


class CandumpBatches(CandumpReader):
    """The frames of a recording in batches, in their order; ``bus`` is the place in ``channels``.

    Counters and errors are those of :class:`CandumpReader`.
    """

    def __init__(self, file: str | Path) -> None:
        """``file``: a path (.gz: compressed)."""
        super().__init__(file)
        self.path = Path(file)
        self.channels: list[str] = []
        """Names of the interfaces, in the order in which they appear."""
        self.n_bytes = 0
        """Bytes of text read so far."""
        self._names = np.zeros((MAX_CHANNELS, _LONGEST_NAME), np.uint8)
        self._lengths = np.zeros(MAX_CHANNELS, np.int64)
        self._batch = FrameBatch(CAPACITY)

    def batches(self) -> Iterator[FrameBatch]:
        """Read to the end; a batch is valid until the next one.

        Raises:
            ConfigError: the file cannot be read, holds no frame at all, or too many interfaces.
        """
        try:
            opens: Any = gzip.open if self.path.suffix == ".gz" else open
            with opens(self.path, "rb") as file:
                yield from self._blocks(file)
        except (EOFError, zlib.error):  # the end of a compressed file that a killed recorder left
            self.is_cut = True
        except OSError as error:
            wanted = f"one that can be read ({error.strerror or error})"
            raise ConfigError(self.name, [Fault("file", None, wanted)]) from error
        if self._batch.n:
            yield self._batch
            self._batch.clear()
        if not self.n_frames:
            raise ConfigError(self.name, self._faults or [Fault("file", None, "a recording: it is empty")])

    def _blocks(self, file: Any) -> Iterator[FrameBatch]:
        rest, number = b"", 0
        while block := file.read1(BLOCK):
            self.n_bytes += len(block)
            rest += block
            if b"\r" in rest:  # as text files are read everywhere
                held = b"\r" if rest.endswith(b"\r") else b""
                rest = rest.removesuffix(b"\r").replace(b"\r\n", b"\n").replace(b"\r", b"\n") + held
            end = rest.rfind(b"\n") + 1
            if not end and len(rest) > LONGEST_LINE:
                end = len(rest) // LONGEST_LINE * LONGEST_LINE
            for batch, lines in self._take(rest[:end], number):
                number += lines
                if batch:
                    yield batch
                if not self.n_frames and self.n_strange >= MAX_STRANGE:
                    return
            rest = rest[end:]
        if rest.endswith(b"\r"):
            for _ in self._take(rest[:-1] + b"\n", number):
                pass
        elif rest:
            self.is_cut = True

    def _take(self, block: bytes, number: int) -> Iterator[tuple[FrameBatch | None, int]]:
        """Take whole lines; yield full batches, and how many lines were taken since."""
        text = np.frombuffer(block, np.uint8)
        at, batch = 0, self._batch
        while at < len(block):
            frames, before = batch.frames, batch.n
            at, batch.n, lines = _parse(
                text,
                at,
                self._names,
                self._lengths,
                len(self.channels),
                frames["can_id"],
                frames["length"],
                frames["flags"],
                frames["bus"],
                frames["data"],
                batch.t_ns,
                batch.n,
            )
            self.n_frames += batch.n - before
            number += lines
            if batch.n < CAPACITY and at < len(block):
                end = block.find(b"\n", at) + 1 or len(block)
                number += 1
                lines += 1
                line = block[at:end].decode("ascii", "replace")
                at = end
                for k in range(0, len(line), LONGEST_LINE):
                    if parsed := self._parsed(line[k : k + LONGEST_LINE], number):
                        self._add(*parsed)
            if batch.n == CAPACITY:
                yield batch, lines
                batch.clear()
            else:
                yield None, lines

    def _parsed(self, line: str, number: int) -> tuple[Frame, str] | None:
        """Return the frame of a line, if it fits the columns."""
        parsed = self._frame_of(line, number)
        if parsed and parsed[0].t_ns > _LAST_NS:
            self._note(number, line, "a time before the year 2262")
            return None
        return parsed

    def _add(self, frame: Frame, channel: str) -> None:
        """Add a frame that the kernel left; its interface may be new."""
        if channel not in self.channels:
            if len(self.channels) == MAX_CHANNELS:
                wanted = f"at most {MAX_CHANNELS}"
                raise ConfigError(self.name, [Fault("interfaces", len(self.channels) + 1, wanted)])
            name = channel.encode("ascii", "replace")
            if len(name) <= _LONGEST_NAME and "\ufffd" not in channel:
                k = len(self.channels)
                self._names[k, : len(name)] = np.frombuffer(name, np.uint8)
                self._lengths[k] = len(name)
            self.channels.append(channel)
        self.n_frames += 1
        self._batch.append(frame._replace(bus=self.channels.index(channel)))


@inner_kernel
def _digit(character: Any) -> Any:
    """Return the value of a hexadecimal digit, -1 for what is none."""
    if 48 <= character <= 57:
        return character - 48
    if 65 <= character <= 70:
        return character - 55
    if 97 <= character <= 102:
        return character - 87
    return -1


@kernel
def _parse(
    text: Any,
    at: Any,
    names: Any,
    name_length: Any,
    n_names: Any,
    can_id: Any,
    length: Any,
    flags: Any,
    bus: Any,
    data: Any,
    t_ns: Any,
    n: Any,
) -> Any:
    """Parse lines from ``at`` on until one is not plain or the columns are full; return at, n, lines."""
    lines = 0
    while at < len(text) and n < len(can_id):
        i = at
        if text[i] != 40:  # (
            break
        i += 1
        seconds, digits = 0, 0
        while i < len(text) and digits < 11 and 48 <= text[i] <= 57:
            seconds = 10 * seconds + (text[i] - 48)
            i, digits = i + 1, digits + 1
        if not 1 <= digits <= 10 or seconds > 9_223_372_035 or i >= len(text) or text[i] != 46:  # .
            break
        i += 1
        fraction, digits = 0, 0
        while i < len(text) and digits < 10 and 48 <= text[i] <= 57:
            fraction = 10 * fraction + (text[i] - 48)
            i, digits = i + 1, digits + 1
        if not 1 <= digits <= 9:
            break
        for _ in range(9 - digits):
            fraction *= 10
        if i + 2 >= len(text) or text[i] != 41 or text[i + 1] != 32:  # ) and a space
            break
        i += 2
        found = -1
        for k in range(n_names):
            m = name_length[k]
            if m == 0 or i + m >= len(text) or text[i + m] != 32:
                continue
            same = True
            for j in range(m):
                same &= text[i + j] == names[k, j]
            if same:
                found = k
                break
        if found < 0:
            break
        i += name_length[found] + 1
        number, digits = 0, 0
        while i < len(text) and digits < 9:
            value = _digit(text[i])
            if value < 0:
                break
            number = 16 * number + value
            i, digits = i + 1, digits + 1
        if i >= len(text) or text[i] != 35 or not (digits == 8 or (digits == 3 and number <= 0x7FF)):  # #
            break
        i += 1
        kind = 0
        if digits == 8:
            kind = ERROR if number & 0x2000_0000 else EXTENDED
            number &= 0x1FFF_FFFF
        most = 8
        if i + 1 < len(text) and text[i] == 35:
            bits = _digit(text[i + 1])
            if bits < 0:
                break
            kind |= FD | (BRS if bits & 1 else 0) | (ESI if bits & 2 else 0)
            most = MAX_DATA
            i += 2
        m = 0
        while i + 1 < len(text) and m < most:
            high, low = _digit(text[i]), _digit(text[i + 1])
            if high < 0 or low < 0:
                break
            data[n, m] = 16 * high + low
            i, m = i + 2, m + 1
        if i >= len(text) or text[i] != 10:
            break
        for j in range(m, MAX_DATA):
            data[n, j] = 0
        can_id[n], length[n], flags[n], bus[n] = number, m, kind, found
        t_ns[n] = seconds * 1_000_000_000 + fraction
        n += 1
        lines += 1
        at = i + 1
    return at, n, lines
