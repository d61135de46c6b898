"""Recordings as candump text, both directions; canplayer, Wireshark and python-can read it.

A line is ``(seconds.microseconds) channel frame``; the frame is ``123#0011`` with an 11-bit identifier,
``00000123#0011`` with a 29-bit one, ``123#R`` or ``123#R4`` for a remote frame, ``123##1AABB`` for CAN FD
(1 bit rate switch, 2 error state) and ``20000080#...`` for an error frame. Nothing stands after the data:
Wireshark does not open files with a direction suffix. Source: can-utils, lib.h.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Final, Self, TextIO

from skinbus.bus.clock import Clock, VirtualClock
from skinbus.bus.frame import BRS, ERROR, ESI, EXTENDED, FD, RTR, Frame
from skinbus.errors import ConfigError, Fault

DEFAULT_CHANNEL: Final = "can0"

FLUSH_NS: Final = 1_000_000_000
"""What is recorded reaches the file within this time, so that a killed process loses little."""

MAX_FAULTS: Final = 20
"""A file that is no recording at all is not listed line by line."""

_ERROR_MARK: Final = 0x2000_0000
_LINE: Final = re.compile(
    r"\((?P<s>\d{1,10})\.(?P<fraction>\d{1,9})\) +(?P<channel>\S+) +(?P<id>[0-9A-F]{3}|[0-9A-F]{8})#"
    r"(?:(?P<remote>R[0-8]?)|#(?P<fd>[0-9A-F])(?P<fd_data>(?:[0-9A-F]{2}){0,64})|(?P<data>(?:[0-9A-F]{2}){0,8}))"
    r"(?: [RT])?",  # python-can's suffix is read, never written
    re.IGNORECASE,
)
_WANTED: Final = "(seconds.microseconds) channel identifier#data, as candump -L writes it"


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
    match = _LINE.fullmatch(line.strip())
    if match is None:
        raise ValueError(f"got {line.strip()!r}; wanted {_WANTED}")
    t_ns = int(match["s"]) * 1_000_000_000 + int(match["fraction"].ljust(9, "0"))
    number = int(match["id"], 16)
    flags = 0
    if len(match["id"]) == 8:
        flags = ERROR if number & _ERROR_MARK else EXTENDED
        number &= 0x1FFF_FFFF
    elif number > 0x7FF:
        raise ValueError(f"got identifier {match['id']}; wanted at most 7FF, or eight digits")
    if match["remote"]:
        return Frame(number, bytes(int(match["remote"][1:] or 0)), t_ns, flags | RTR), match["channel"]
    if match["fd"]:
        fd_flags = int(match["fd"], 16)
        flags |= FD | (BRS if fd_flags & 1 else 0) | (ESI if fd_flags & 2 else 0)
        return Frame(number, bytes.fromhex(match["fd_data"]), t_ns, flags), match["channel"]
    return Frame(number, bytes.fromhex(match["data"]), t_ns, flags), match["channel"]


def read_candump(file: str | Path | TextIO, *, channel: str | None = None) -> Iterator[Frame]:
    """The frames of a recording in their order, of one channel or of all.

    Raises ConfigError with the faults of the whole file at the first bad line; a last line cut short, as a
    killed recorder leaves it, ends the recording.
    """
    if isinstance(file, str | Path):
        try:
            with Path(file).open(encoding="ascii", errors="replace") as lines:
                yield from _read(lines, str(file), channel)
        except OSError as error:
            raise ConfigError(
                str(file), [Fault("file", None, f"one that can be read ({error.strerror})")]
            ) from error
    else:
        yield from _read(file, getattr(file, "name", "recording"), channel)


def _read(lines: TextIO, name: str, channel: str | None) -> Iterator[Frame]:
    faults = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            frame, where = parse_line(line)
        except ValueError as error:
            if line.endswith("\n"):
                faults.append(Fault(f"line {number}", line.strip()[:80], str(error).rpartition("wanted ")[2]))
            if len(faults) == MAX_FAULTS:
                break
            continue
        if not faults and channel in (None, where):
            yield frame
    if faults:
        raise ConfigError(name, faults)


class CandumpWriter:
    """Writes every frame it is called with; a tap for ``Wire`` and ``PythonCanBus``; to be closed."""

    def __init__(
        self,
        file: str | Path | TextIO,
        *,
        channel: str = DEFAULT_CHANNEL,
        clock: Clock | None = None,
    ) -> None:
        """Begin a new recording.

        channel  the name of the bus in the file
        clock    clock of the frames' times, to know their Unix time; by default times are written as they are
        """
        self.n_frames = 0
        self._channel = channel
        self._clock = clock or VirtualClock()
        self._owned = isinstance(file, str | Path)
        self._file: TextIO = _create(file) if isinstance(file, str | Path) else file
        self._last_ns = 0
        self._flushed_ns = 0

    def __call__(self, frame: Frame) -> None:
        """Write one frame; a time before the last frame's becomes the last frame's, as players want it."""
        wall_ns = max(self._clock.wall_ns(frame.t_ns), self._last_ns)
        self._last_ns = wall_ns
        self._file.write(format_line(frame, channel=self._channel, wall_ns=wall_ns) + "\n")
        self.n_frames += 1
        if wall_ns - self._flushed_ns >= FLUSH_NS:
            self._flushed_ns = wall_ns
            self._file.flush()

    def close(self) -> None:
        """Write out what is buffered; a file opened here is closed, and a second call does nothing."""
        if self._owned:
            self._file.close()
        elif not self._file.closed:
            self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _create(path: str | Path) -> TextIO:
    return Path(path).open("w", encoding="ascii")
