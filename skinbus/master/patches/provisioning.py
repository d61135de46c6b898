"""The boot of one patch (after CiA 302-2): is it the device the arm file asks for, and is it configured.

A boot is a script (see ``talks``): the supervisor holds many of them side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import NamedTuple

from skinbus.master.commissioning.sdo_sessions import Reply, Request, Script
from skinbus.objects import cia
from skinbus.objects.dcf import Configuration


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """What a patch must say it is; zero means that any value will do (CiA 302-2, 0x1F84-0x1F88)."""

    device_type: int = 0
    vendor: int = 0
    product: int = 0
    revision: int = 0
    serial: int = 0


class Ending(Enum):
    """How a boot can end."""

    ACCEPTED = auto()
    """The patch may be started."""
    REFUSED = auto()
    """It answers, but is not what is wanted."""
    NO_ANSWER = auto()
    RESET = auto()
    """It has to be reset, and boots again after that."""
    ASKED = auto()
    """This was no boot: it was only asked for its errors."""


class Verdict(NamedTuple):
    """How a boot ended, why, how many objects were downloaded on the way, and the error that is there."""

    ending: Ending
    reason: str = ""
    n_written: int = 0
    error: int | None = 0
    """EMCY code of the last error of a patch that was accepted or asked; 0 for none, None: it did not say."""


LOAD = cia.SIGNATURE_LOAD.to_bytes(4, "little")


def boot(identity: Identity, configuration: Configuration, *, restored: bool = False) -> Script[Verdict]:
    """Check and configure one patch object by object, as the figures "boot NMT slave" of CiA 302-2 do.

    Last it is asked for its errors: what it said of them while it booted may have gone unheard.
    ``restored``: its defaults have been restored since it was last accepted.
    """
    verdict = yield from _check(identity, configuration, restored=restored)
    return (yield from _ask_error(verdict)) if verdict.ending is Ending.ACCEPTED else verdict


def _check(identity: Identity, configuration: Configuration, *, restored: bool) -> Script[Verdict]:
    """The boot without its end."""
    refusal = yield from check_identity(identity)
    if refusal is not None:
        return refusal
    marks = []
    for sub in (cia.VERIFY_DATE, cia.VERIFY_TIME):
        reply = yield Request(cia.VERIFY_CONFIGURATION, sub)
        if is_silent(reply):
            return Verdict(Ending.NO_ANSWER, "configuration date and time")
        marks.append(None if reply.abort else int.from_bytes(reply.data, "little"))
    wanted = [configuration.date, configuration.time] if configuration.writes else [0, 0]
    if marks == wanted or not (any(marks) or configuration.writes):
        return Verdict(Ending.ACCEPTED)
    if any(marks) and not restored:
        # It holds another configuration, of which more may remain than the new one writes over.
        reply = yield Request(cia.RESTORE_DEFAULTS, cia.STORE_ALL, LOAD)
        if not reply.abort:
            return Verdict(Ending.RESET, "had a configuration that is not in the arm file")
        if is_silent(reply) or not configuration.writes:
            return _refused("restoring the defaults", reply)
    if not configuration.writes:
        return Verdict(Ending.REFUSED, "keeps a configuration that is not in the arm file")
    return (yield from _configure(configuration))


def check_identity(identity: Identity) -> Script[Verdict | None]:
    """Return None for the right device, else the verdict."""
    checks = [
        (cia.DEVICE_TYPE, 0, identity.device_type, "device type"),
        (cia.IDENTITY, cia.IDENTITY_VENDOR, identity.vendor, "vendor"),
        (cia.IDENTITY, cia.IDENTITY_PRODUCT, identity.product, "product code"),
        (cia.IDENTITY, cia.IDENTITY_REVISION, identity.revision, "revision"),
        (cia.IDENTITY, cia.IDENTITY_SERIAL, identity.serial, "serial number"),
    ]
    for index, sub, wanted, what in checks:
        if (
            not wanted and index != cia.DEVICE_TYPE
        ):  # the first is always read: so a node shows that it is there
            continue
        reply = yield Request(index, sub)
        if reply.abort:
            return _refused(what, reply)
        seen = int.from_bytes(reply.data, "little")
        if wanted and seen != wanted:
            return Verdict(Ending.REFUSED, f"{what} is 0x{seen:X}, wanted 0x{wanted:X}")
    return None


def _configure(configuration: Configuration) -> Script[Verdict]:
    """Download the configuration, and last the marks by which it is known the next time."""
    for index, sub, data in configuration.writes:
        reply = yield Request(index, sub, data)
        if reply.abort:
            return _refused(f"download of 0x{index:04X}:{sub:02X}", reply)
    marks = ((cia.VERIFY_DATE, configuration.date), (cia.VERIFY_TIME, configuration.time))
    for sub, mark in marks:
        reply = yield Request(cia.VERIFY_CONFIGURATION, sub, mark.to_bytes(4, "little"))
        if is_silent(reply):  # a device without 0x1020 is configured at every boot
            return Verdict(Ending.NO_ANSWER, "configuration date and time")
    return Verdict(Ending.ACCEPTED, n_written=len(configuration.writes))


def ask_error() -> Script[Verdict]:
    """Ask a patch at work for its errors; when it does not answer, its heartbeat tells of that."""
    verdict = yield from _ask_error(Verdict(Ending.ASKED))
    return verdict if verdict.ending is Ending.ASKED else Verdict(Ending.ASKED, error=None)


def _ask_error(verdict: Verdict) -> Script[Verdict]:
    """Add the error that the error register tells of, by the code that the patch kept of it."""
    reply = yield Request(cia.ERROR_REGISTER, 0)
    if is_silent(reply):
        return Verdict(Ending.NO_ANSWER, "error register")
    if reply.abort or not any(reply.data):
        return verdict
    reply = yield Request(cia.ERROR_HISTORY, cia.LAST_ERROR)
    if is_silent(reply):
        return Verdict(Ending.NO_ANSWER, "last error")
    code = 0 if reply.abort else int.from_bytes(reply.data[:2], "little")
    return verdict._replace(error=code or cia.EmcyCode.GENERIC)


def _refused(what: str, reply: Reply) -> Verdict:
    if is_silent(reply):
        return Verdict(Ending.NO_ANSWER, what)
    return Verdict(Ending.REFUSED, f"{what}: SDO aborted with 0x{reply.abort:08X}")


def is_silent(reply: Reply) -> bool:
    return reply.abort == cia.AbortCode.TIMEOUT
