"""The boot of one patch (after CiA 302-2): is it the device the arm file asks for, and is it configured.

A boot is a generator: it yields SDO requests and is sent the replies, so that it reads like the
conversation it is, while the supervisor holds many of them side by side without threads.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import NamedTuple

from skinbus.objects import cia


@dataclass(frozen=True, slots=True)
class Request:
    """An SDO transfer that the boot asks for: a download when there is data, else an upload."""

    index: int
    sub: int
    data: bytes | None = None


class Reply(NamedTuple):
    """What came of it: data, or the abort code (0 for none)."""

    data: bytes = b""
    abort: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """What a patch must say it is; zero means that any value will do (CiA 302-2, 0x1F84-0x1F88)."""

    device_type: int = 0
    vendor: int = 0
    product: int = 0
    revision: int = 0
    serial: int = 0


class Verdict(NamedTuple):
    """How a boot ended: whether the patch may be started, and if not, why."""

    accepted: bool
    reason: str = ""
    answered: bool = True


Boot = Generator[Request, Reply, Verdict]


def boot(identity: Identity) -> Boot:
    """Check the identity of one patch object by object, as CiA 302-2 figure "boot NMT slave" does."""
    checks = [
        (cia.DEVICE_TYPE, 0, identity.device_type, "device type"),
        (cia.IDENTITY, 1, identity.vendor, "vendor"),
        (cia.IDENTITY, 2, identity.product, "product code"),
        (cia.IDENTITY, 3, identity.revision, "revision"),
        (cia.IDENTITY, 4, identity.serial, "serial number"),
    ]
    for n, (index, sub, wanted, what) in enumerate(checks):
        if n and not wanted:  # the device type is always read: it is how a node shows that it is there
            continue
        reply = yield Request(index, sub)
        if reply.abort:
            answered = reply.abort != cia.AbortCode.TIMEOUT
            return Verdict(False, f"{what}: SDO aborted with 0x{reply.abort:08X}", answered)
        seen = int.from_bytes(reply.data, "little")
        if wanted and seen != wanted:
            return Verdict(False, f"{what} is 0x{seen:X}, wanted 0x{wanted:X}")
    return Verdict(True)
