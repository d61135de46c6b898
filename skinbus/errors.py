"""The error tree: what can go wrong, and whose fault it is.

::

    SkinbusError
    ├── ConfigError(ValueError)        a file of ours is wrong: its faults at once, ten of a kind
    │   ├── MissingFileError(FileNotFoundError)   there is no such file
    │   └── EdsError                   the same for EDS and DCF files
    ├── AddressError(ValueError)       what was said of interfaces and channels fits no bus of the arm
    ├── ArgumentError(ValueError)      a program asked for a level, patch, frame ... that there is not
    ├── BusError(OSError)              the bus cannot be opened, or is gone
    ├── ShareError(OSError)            shared memory is not there, in use, or of another layout
    └── ProtocolError
        ├── LocalProtocolError         we asked for something illegal
        └── RemoteProtocolError        the peer did
            └── SdoAborted             the peer aborted an SDO transfer

Bytes from the wire never raise: cores count and drop them and report an event.
Non-convergence of the estimator is a status in the contact, not an error.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from skinbus.formatting import counted
from skinbus.printable import printable, shown_value

MAX_FAULTS = 100
"""Faults of all kinds together that are listed: four screens."""

MAX_ALIKE = 10
"""Faults of one kind that are listed for a file: a thousand of them need no list."""

MAX_WANTED = 1000
"""Characters of what was wanted: lists of ours have a third of it, names in a file any length."""

_NO_NUMBERS = str.maketrans("", "", "0123456789ABCDEF")


class SkinbusError(Exception):
    """Anything that skinbus raises on purpose."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that is wrong in a file: where, what was seen, what was wanted."""

    key: str
    seen: Any
    wanted: str

    def __str__(self) -> str:
        seen = "" if self.seen is None else f" is {shown_value(self.seen)};"
        return f"{printable(self.key)}:{seen} wanted {printable(self.wanted, limit=MAX_WANTED)}"

    @property
    def kind(self) -> str:
        """What equal faults at other places have in common."""
        return self.wanted.translate(_NO_NUMBERS)


class FaultList(list[Fault]):
    """Faults as they are found; of each kind the first are kept and the others counted."""

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        super().__init__()
        self.n_of_kind: Counter[str] = Counter()
        self.n_more = 0
        """Faults that are not in the list."""
        self.extend(faults)

    def append(self, fault: Fault) -> None:
        """Add a fault, or count it."""
        self.n_of_kind[fault.kind] += 1
        if self.n_of_kind[fault.kind] <= MAX_ALIKE and len(self) < MAX_FAULTS:
            super().append(fault)
        else:
            self.n_more += 1

    def add(self, key: str, seen: Any, wanted: str) -> None:
        """Add the fault of a key, or count it."""
        self.append(Fault(key, seen, wanted))

    def extend(self, faults: Iterable[Fault]) -> None:
        """Add faults, or count them."""
        for fault in faults:
            self.append(fault)
        if isinstance(faults, FaultList):
            self.n_more += faults.n_more

    def __iadd__(self, faults: Iterable[Fault]) -> Self:  # type: ignore[override,misc]  # wider than a list's
        self.extend(faults)
        return self


class ConfigError(SkinbusError, ValueError):
    """A file was refused; ``faults`` holds what is wrong in it, ten of a kind at most."""

    def __init__(self, file: str | Path, faults: Sequence[Fault]) -> None:
        found = faults if isinstance(faults, FaultList) else FaultList(faults)
        self.file = str(file)
        self.faults = tuple(found)
        self.n_more = found.n_more
        """Faults that are like others and not in ``faults``."""
        super().__init__(self.file, found)

    @classmethod
    def of(cls, file: str | Path, key: str, seen: Any, wanted: str) -> Self:
        """Return the error of a file with one fault."""
        return cls(file, [Fault(key, seen, wanted)])

    def __str__(self) -> str:
        n = counted(len(self.faults) + self.n_more, "fault")
        lines = [f"{printable(self.file)}: {n}"]
        lines += [f"  {fault}" for fault in self.faults]
        return "\n".join(lines + ([f"  and {self.n_more} more like these"] if self.n_more else []))


class MissingFileError(ConfigError, FileNotFoundError):
    """There is no such file."""


class EdsError(ConfigError):
    """An EDS or DCF file was refused; keys read ``[section] key``."""


class AddressError(SkinbusError, ValueError):
    """What was said of interfaces and channels fits no bus of the arm."""


class ArgumentError(SkinbusError, ValueError):
    """A program asked for a level, patch, link, frame or event that there is not."""


class BusError(SkinbusError, OSError):
    """The bus cannot be opened or has gone away."""


class ShareError(SkinbusError, OSError):
    """Shared memory is not there, in use, or of another layout."""


class ProtocolError(SkinbusError):
    """A rule of CANopen was broken."""


class LocalProtocolError(ProtocolError):
    """We asked for something the protocol does not allow."""


class RemoteProtocolError(ProtocolError):
    """The peer broke the protocol or refused."""


class SdoAborted(RemoteProtocolError):
    """An SDO transfer was aborted with ``code`` (CiA 301, 7.2.4.3.17)."""

    def __init__(self, node_id: int, index: int, sub: int, code: int) -> None:
        self.node_id, self.index, self.sub, self.code = node_id, index, sub, code
        super().__init__(f"node {node_id}: SDO 0x{index:04X}:{sub:02X} aborted with 0x{code:08X}")


@contextmanager
def extra_wanted(name: str) -> Iterator[None]:
    """Turn a missing library of an extra into one clear message."""
    try:
        yield
    except ImportError as error:
        raise SkinbusError(f"this needs {error.name}: pip install 'skinbus[{name}]'") from error
