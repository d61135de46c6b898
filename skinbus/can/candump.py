"""Recordings as candump text, both directions; canplayer, Wireshark and python-can can read what is written.

A line is ``(seconds.microseconds) channel frame``; the frame is ``123#0011`` with an 11-bit identifier,
``00000123#0011`` with a 29-bit one, ``123#R`` or ``123#R4`` for a remote frame, ``123##1AABB`` for CAN FD
(1 bit rate switch, 2 error state) and ``20000080#...`` for an error frame. Nothing is written after the data:
Wireshark does not open files with a direction suffix. Source: can-utils, lib.h.
"""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TextIO

from skinbus.can.clock import Clock, VirtualClock
from skinbus.can.fd import CLASSIC_BYTES
from skinbus.can.frame import BRS, ERROR, ESI, EXTENDED, FD, MAX_DATA, RTR, Frame, Frames
from skinbus.errors import ConfigError, Fault, FaultList, MissingFileError

DEFAULT_CHANNEL = "can0"

MAX_FAULTS = 3
"""A file that is no recording at all is not listed line by line."""

MAX_STRANGE = 1000
"""Lines without a single frame before them, after which a file is no recording."""

LONGEST_LINE = 1024
"""Characters; a line of 64 bytes has 200. What is longer is no line of a recording."""

_ERROR_MARK = 0x2000_0000
_LOG = re.compile(
    r"\s*\((\d{1,10})\.(\d{1,9})\)\s+(\S+)\s+([0-9A-F]{3}|[0-9A-F]{8})#"
    r"(?:(R[0-8]?)|(#[0-9A-F])?([0-9A-F]*))(?:_[9-F])?"
    r"(?: [RT])?\s*",  # the direction of candump -x and python-can is read, never written
    re.IGNORECASE,
)
_DROPPED = re.compile(r"DROPCOUNT: dropped (\d{1,10}) CAN frames? on .*\s*")
_WANTED = "(seconds.microseconds) channel identifier#data, as candump -l and -L write it"


def format_line(frame: Frame, *, channel: str = DEFAULT_CHANNEL, wall_ns: int | None = None) -> str:
    """The frame as a line without its end; ``wall_ns`` is its Unix time, by default ``frame.t_ns``."""
    can_id, data, t_ns, flags, _ = frame
    us = (t_ns if wall_ns is None else wall_ns) // 1000
    if flags & ERROR:
        name = f"{can_id & 0x1FFF_FFFF | _ERROR_MARK:08X}"
    else:
        name = f"{can_id:08X}" if flags & EXTENDED else f"{can_id:03X}"
    if flags & RTR:
        body = f"R{len(data) or ''}"
    elif flags & FD:
        body = f"#{(1 if flags & BRS else 0) | (2 if flags & ESI else 0):X}{data.hex().upper()}"
    else:
        body = data.hex().upper()
    return f"({us // 1_000_000}.{us % 1_000_000:06d}) {channel} {name}#{body}"


def parse_line(line: str) -> tuple[Frame, str]:
    """The frame and the channel of a line; raises ValueError if it is none."""
    if not (match := _LOG.fullmatch(line)):
        raise ValueError(f"got {line.strip()[:80]!r}; wanted {_WANTED}")
    seconds, fraction, channel, name, remote, fd, digits = match.groups("")
    if len(digits) % 2:
        raise ValueError(f"got {len(digits)} digits; wanted two for each byte")
    flags, data = 0, bytes.fromhex(digits)
    if fd:
        bits = int(fd[1], 16)
        flags = FD | (BRS if bits & 1 else 0) | (ESI if bits & 2 else 0)
    if remote:
        flags, data = RTR, bytes(int(remote[1:] or 0))
    longest = MAX_DATA if flags & FD else CLASSIC_BYTES
    if len(data) > longest:
        raise ValueError(f"got {len(data)} bytes; wanted at most {longest}")
    t_ns = int(seconds) * 1_000_000_000 + int(fraction.ljust(9, "0"))
    number = int(name, 16)
    if len(name) == 8:
        flags |= ERROR if number & _ERROR_MARK else EXTENDED
        number &= 0x1FFF_FFFF
    elif number > 0x7FF:
        raise ValueError(f"got identifier {name}; wanted at most 7FF, or eight digits")
    return Frame(number, data, t_ns, flags), channel


class CandumpReader:
    """The frames of a recording with their channels, in their order; to be gone through once.

    A line that is no frame is counted and left out. A last line without an end is one that a killed recorder
    did not finish, and left out too.
    """

    def __init__(self, file: str | Path | TextIO) -> None:
        """``file``: a path (.gz: compressed), or text that is read from where it stands."""
        self.name = str(file) if isinstance(file, str | Path) else str(getattr(file, "name", "recording"))
        self.n_frames = 0
        self.n_strange = 0
        """Lines that are no frame."""
        self.first_strange: Fault | None = None
        self.n_dropped = 0
        """Frames that the recorder says it had no room for."""
        self.is_cut = False
        """Whether the last line was left out."""
        self._file = file
        self._faults = FaultList()

    def __iter__(self) -> Iterator[tuple[Frame, str]]:
        """Read to the end.

        Raises:
            ConfigError: the file cannot be read, or holds no frame at all.
        """
        if isinstance(self._file, str | Path):
            try:
                with _open(self._file, "rt") as lines:
                    yield from self._read(lines)
            except (EOFError, zlib.error):  # the end of a compressed file that a killed recorder left
                self.is_cut = True
            except OSError as error:
                wanted = f"one that can be read ({error.strerror or error})"
                kind = MissingFileError if isinstance(error, FileNotFoundError) else ConfigError
                raise kind(self.name, [Fault("file", None, wanted)]) from error
        else:
            yield from self._read(self._file)
        if not self.n_frames:
            raise ConfigError(self.name, self._faults or [Fault("file", None, "a recording: it is empty")])

    def _read(self, lines: TextIO) -> Iterator[tuple[Frame, str]]:
        number = 0
        while line := lines.readline(LONGEST_LINE):
            number += 1
            if not line.endswith("\n") and len(line) < LONGEST_LINE:
                self.is_cut = True
                return
            if parsed := self._frame_of(line, number):
                self.n_frames += 1
                yield parsed
            elif not self.n_frames and self.n_strange >= MAX_STRANGE:
                return

    def _frame_of(self, line: str, number: int) -> tuple[Frame, str] | None:
        """Return the frame and the channel of a line; what is none is counted."""
        try:
            return parse_line(line)
        except ValueError as error:
            if match := _DROPPED.fullmatch(line):
                self.n_dropped += int(match[1])
            elif line.strip():
                self.n_strange += 1
                if len(self._faults) < MAX_FAULTS:
                    wanted = str(error).rpartition("wanted ")[2]
                    self._faults.add(f"line {number}", line.strip()[:80], wanted)
                    self.first_strange = self._faults[0]
            return None


class CandumpWriter:
    """Writes every frame it is called with; a tap for ``VirtualBus`` and ``PythonCanBus``; to be closed.

    Lines are written whole and at once: a killed recorder has lost the last one at most.
    """

    def __init__(
        self,
        file: str | Path | TextIO,
        *,
        channels: Sequence[str] = (DEFAULT_CHANNEL,),
        clock: Clock | None = None,
    ) -> None:
        """Begin a new recording (.gz: compressed); FileExistsError if there is such a file.

        channels  the names of the buses in the file, by their numbers
        clock     clock of the frames' times, for their Unix time; by default times are written as they
                  are
        """
        self.n_frames = 0
        self.first_ns = self.last_ns = 0
        """Unix times (ns) of the first frame and of the last."""
        self._channels = tuple(channels)
        self._clock = clock or VirtualClock()
        self._owned = isinstance(file, str | Path)
        self._file: TextIO = _open(file, "xt") if isinstance(file, str | Path) else file

    def write(self, frames: Frames) -> None:
        """Write frames; a time before the last frame's becomes the last frame's, as players want it."""
        lines = []
        for frame in frames:
            self.last_ns = max(self._clock.wall_ns(frame.t_ns), self.last_ns)
            lines.append(format_line(frame, channel=self._channels[frame.bus], wall_ns=self.last_ns))
            if not self.n_frames:
                self.first_ns = self.last_ns
            self.n_frames += 1
        self._put(lines)

    def dropped(self, n: int, bus: int, n_so_far: int) -> None:
        """Write that frames of a bus are missing here, in the words of candump -d."""
        thing = "frames" if n > 1 else "frame"
        where = f"'{self._channels[bus]}' socket (total drops {n_so_far})"
        self._put([f"DROPCOUNT: dropped {n} CAN {thing} on {where}"])

    def close(self) -> None:
        """A file opened here is closed; a second call does nothing."""
        if self._owned:
            self._file.close()

    def _put(self, lines: Sequence[str]) -> None:
        if lines:
            self._file.write("\n".join(lines) + "\n")
            self._file.flush()


def _open(path: str | Path, mode: str) -> TextIO:
    """Open the text of a recording, compressed or not."""
    opens: Any = gzip.open if str(path).endswith(".gz") else open
    text: TextIO = opens(path, mode, encoding="ascii", errors="replace")
    return text
