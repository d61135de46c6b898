"""The error tree: what can go wrong, and whose fault it is.

::

    SkinbusError
    ├── ConfigError(ValueError)        a file of ours is wrong: every fault of it at once
    │   └── EdsError                   the same for EDS and DCF files
    ├── AddressError(ValueError)       what was said of interfaces and channels fits no bus of the arm
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

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


class SkinbusError(Exception):
    """Anything that skinbus raises on purpose."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that is wrong in a file: where, what was seen, what was wanted."""

    key: str
    seen: Any
    wanted: str

    def __str__(self) -> str:
        seen = "" if self.seen is None else f" is {self.seen!r};"
        return f"{self.key}:{seen} wanted {self.wanted}"


class ConfigError(SkinbusError, ValueError):
    """A file was refused; ``faults`` holds every fault found in it."""

    def __init__(self, file: str, faults: Sequence[Fault]) -> None:
        self.file = file
        self.faults = tuple(faults)
        super().__init__(file, self.faults)

    def __str__(self) -> str:
        n = len(self.faults)
        head = f"{self.file}: {n} fault{'' if n == 1 else 's'}"
        return "\n".join([head, *(f"  {fault}" for fault in self.faults)])


class EdsError(ConfigError):
    """An EDS or DCF file was refused; keys read ``[section] key``."""


class AddressError(SkinbusError, ValueError):
    """What was said of interfaces and channels fits no bus of the arm."""


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
