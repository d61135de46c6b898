"""Provisioning of one patch (after CiA 302-2): is it the device the arm file asks for, and is it configured.

The master runs it at every boot of a patch; ``skinbus configure`` runs the same script with every value read
back and stored. A patch that holds a configuration of another arm file gets its defaults back first: what the
arm file does not name must not stay behind.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final, NamedTuple

from skinbus.master.commissioning.sessions import Reply, Request, Script
from skinbus.objects import cia
from skinbus.objects.dcf import Configuration

LOAD: Final = cia.SIGNATURE_LOAD.to_bytes(4, "little")
SAVE: Final = cia.SIGNATURE_SAVE.to_bytes(4, "little")

NO_VALUE: Final = (cia.AbortCode.WRITE_ONLY, cia.AbortCode.NO_DATA)
"""Why a value that can be written may have none to read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """Identity of a patch; zero means that any value will do (CiA 302-2, 0x1F84-0x1F88)."""

    device_type: int = 0
    vendor: int = 0
    product: int = 0
    revision: int = 0
    serial: int = 0


class Provision(StrEnum):
    """What provisioning came to."""

    SAME = "as asked"
    """It held everything already."""
    CHANGED = "changed"
    """It holds everything now, and has stored it if that was wanted."""
    WOULD_CHANGE = "would change"
    """It differs; nothing was written."""
    NOT_STORED = "not stored"
    """It holds everything, until it is switched off."""
    REFUSED = "refused"
    """Another device, or it did not take a value."""
    ABSENT = "absent"
    """It did not answer, or stopped answering."""
    RESTORED = "restored"
    """Its defaults are restored: it has to be reset, and provisioned again."""

    @property
    def is_good(self) -> bool:
        """Whether nothing is left to do."""
        return self in (Provision.SAME, Provision.CHANGED)


class Change(NamedTuple):
    """One value of a patch that differs from what is asked for; ``old`` is None when it cannot be read."""

    index: int  # type: ignore[assignment]  # hides tuple.index, which nobody wants here
    sub: int
    old: bytes | None
    new: bytes


@dataclass(frozen=True, slots=True)
class Provisioned:
    """What came of one patch, why, and what changed."""

    outcome: Provision
    reason: str = ""
    changes: tuple[Change, ...] = ()
    """Values read that differed; at a boot none are read."""
    n_written: int = 0
    """Objects downloaded."""
    is_restored: bool = False
    """Its defaults were restored, since it held a configuration of another arm file."""
    error: int = 0
    """EMCY code of its last error, if that was asked for; 0 for none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """How far provisioning goes."""

    reads_all: bool = False
    """Every value of the configuration is read before and after the download, not the marks alone."""
    writes: bool = True
    stores: bool = False
    asks_error: bool = False
    """Last its errors are read: an EMCY that it sent while it booted may be lost."""


BOOT: Final = Task(asks_error=True)
CONFIGURE: Final = Task(reads_all=True, stores=True)
COMPARE: Final = Task(reads_all=True, writes=False)


def provision(
    identity: Identity, configuration: Configuration, task: Task, *, is_restored: bool = False
) -> Script[Provisioned]:
    """Check one patch and bring it to its configuration.

    ``is_restored``: its defaults have been restored since it was last good.
    """
    done = yield from _provision(identity, configuration, task, is_restored=is_restored)
    if not (task.asks_error and done.outcome.is_good):
        return done
    error = yield from ask_error()
    if error is None:
        return Provisioned(Provision.ABSENT, "error register")
    return replace(done, error=error)


def _provision(
    identity: Identity, configuration: Configuration, task: Task, *, is_restored: bool
) -> Script[Provisioned]:
    fault = yield from check_identity(identity)
    if fault is not None:
        return fault
    marks = []
    for sub in (cia.VERIFY_DATE, cia.VERIFY_TIME):
        reply = yield Request(cia.VERIFY_CONFIGURATION, sub)
        if reply.is_silent:
            return _failed("configuration date and time", reply)
        marks.append(int.from_bytes(reply.data, "little"))  # 0 of a device without 0x1020
    is_marked = marks == [configuration.date, configuration.time]
    is_foreign = any(marks) and not is_marked
    if is_foreign and task.writes:
        if not is_restored:
            reply = yield Request(cia.RESTORE_DEFAULTS, cia.STORE_ALL, LOAD)
            if not reply.abort:
                return Provisioned(Provision.RESTORED, "had a configuration that is not in the arm file")
            if reply.is_silent or not configuration.writes:
                return _failed("restoring the defaults", reply)
        if not configuration.writes:
            return Provisioned(Provision.REFUSED, "keeps a configuration that is not in the arm file")
    changes: tuple[Change, ...] = ()
    if task.reads_all:
        compared = yield from _compare(final_values(configuration))
        if isinstance(compared, Provisioned):
            return compared
        changes = compared
    if is_marked and not changes:
        return Provisioned(Provision.SAME, is_restored=is_restored)
    if not task.writes:
        reason = "holds a configuration that is not the arm file's" if is_foreign else ""
        return Provisioned(Provision.WOULD_CHANGE, reason, changes)
    done = yield from _download(configuration, changes, task)
    return replace(done, is_restored=is_restored) if done.outcome is not Provision.REFUSED else done


def check_identity(identity: Identity) -> Script[Provisioned | None]:
    """Return None for the right device, else what is wrong."""
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
            return _failed(what, reply)
        seen = int.from_bytes(reply.data, "little")
        if wanted and seen != wanted:
            return Provisioned(Provision.REFUSED, f"{what} is 0x{seen:X}, wanted 0x{wanted:X}")
    return None


def ask_error() -> Script[int | None]:
    """Return the EMCY code of a patch's last error; 0 for none, GENERIC for any, None: no answer."""
    reply = yield Request(cia.ERROR_REGISTER, 0)
    if reply.is_silent:
        return None
    if reply.abort or not any(reply.data):
        return cia.EmcyCode.NO_ERROR
    reply = yield Request(cia.ERROR_HISTORY, cia.LAST_ERROR)
    if reply.is_silent:
        return None
    code = 0 if reply.abort else int.from_bytes(reply.data[:2], "little")
    return code or cia.EmcyCode.GENERIC


def final_values(configuration: Configuration) -> dict[tuple[int, int], bytes]:
    """Return what a patch is to hold when all has been downloaded, by index and sub-index."""
    return {(write.index, write.sub): write.data for write in configuration.writes}


def _compare(values: Mapping[tuple[int, int], bytes]) -> Script[tuple[Change, ...] | Provisioned]:
    """Return which values a patch holds differ, or why they cannot be read."""
    changes = []
    for (index, sub), new in values.items():
        reply = yield Request(index, sub)
        if reply.abort not in (0, *NO_VALUE):
            return _failed(f"read 0x{index:04X}:{sub:02X}", reply)
        old = None if reply.abort else reply.data
        if old != new:
            changes.append(Change(index, sub, old, new))
    return tuple(changes)


def _download(configuration: Configuration, changes: tuple[Change, ...], task: Task) -> Script[Provisioned]:
    """Download all in the order that devices take, read back what can be read, mark and store."""
    for index, sub, data in configuration.writes:
        reply = yield Request(index, sub, data)
        if reply.abort:
            return _failed(f"write 0x{index:04X}:{sub:02X}", reply, changes)
    if task.reads_all:
        unreadable = {(change.index, change.sub) for change in changes if change.old is None}
        values = {key: data for key, data in final_values(configuration).items() if key not in unreadable}
        left = yield from _compare(values)
        if isinstance(left, Provisioned):
            return replace(left, changes=changes)
        if left:
            index, sub, seen, wanted = left[0]
            text = f"reads {seen.hex(' ') if seen else 'nothing'} after {wanted.hex(' ')} was written"
            return Provisioned(Provision.REFUSED, f"0x{index:04X}:{sub:02X} {text}", changes)
    marks = ((cia.VERIFY_DATE, configuration.date), (cia.VERIFY_TIME, configuration.time))
    for sub, mark in marks:
        reply = yield Request(cia.VERIFY_CONFIGURATION, sub, mark.to_bytes(4, "little"))
        if reply.is_silent:  # a device without 0x1020 is configured at every boot
            return _failed("configuration date and time", reply, changes)
    n = len(configuration.writes)
    if task.stores:
        reply = yield Request(cia.STORE_PARAMETERS, cia.STORE_ALL, SAVE)
        if reply.abort:
            return Provisioned(Provision.NOT_STORED, cia.describe_abort(reply.abort), changes, n)
    return Provisioned(Provision.CHANGED, "", changes, n)


def _failed(what: str, reply: Reply, changes: tuple[Change, ...] = ()) -> Provisioned:
    outcome = Provision.ABSENT if reply.is_silent else Provision.REFUSED
    return Provisioned(outcome, f"{what}: {cia.describe_abort(reply.abort)}", changes)
