"""Provisioning of one patch (after CiA 302-2): is it the device the arm file asks for, and is it configured.

The master runs it at every boot of a patch; ``skinbus configure`` runs the same script with every value read
back and stored. A patch that holds a configuration of another arm file gets its defaults back first: what the
arm file does not name must not stay behind.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final, NamedTuple, NoReturn

from canopen.objectdictionary import ObjectDictionary

from skinbus.can.frame import Frame
from skinbus.master.commissioning.sessions import Exchange, Reply, Request, Script
from skinbus.model import Arm
from skinbus.node.sdo_client import ASK_UPLOAD
from skinbus.node.sdo_server import HEAD
from skinbus.objects import cia
from skinbus.objects.dcf import Configuration, Write, configuration, is_verified, repairs
from skinbus.objects.profile import number_at

DOWNLOADS: Final = (1, 6)
"""Client command specifiers that begin a download, in segments and in blocks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """Identity of a patch; zero means that any value will do (CiA 302-2, 0x1F84-0x1F88)."""

    device_type: int = 0
    vendor: int = 0
    product: int = 0
    revision: int = 0
    serial: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedNode:
    """What the master expects of a patch; ``heartbeat_ns`` is the period of its heartbeat, 0 for none."""

    node_id: int
    identity: Identity
    configuration: Configuration
    heartbeat_ns: int = 0


def expected_nodes(arm: Arm, ods: Sequence[ObjectDictionary]) -> list[ExpectedNode]:
    """Return what the master expects of the patches of an arm, by their dictionaries."""
    window_us = round(1e6 / arm.bus.rate_hz)
    return [
        expected_node(node_id, od, window_us=window_us)
        for node_id, od in zip(arm.node_id.tolist(), ods, strict=True)
    ]


def expected_node(node_id: int, od: ObjectDictionary, *, window_us: int = 0) -> ExpectedNode:
    """Return what the EDS of a patch asks for; an identity left out or zero is not checked.

    ``window_us`` is the period of the SYNC: TPDOs of a patch that are later than that it is not to send.
    """
    return ExpectedNode(
        node_id=node_id,
        identity=Identity(
            device_type=number_at(od, cia.DEVICE_TYPE),
            vendor=number_at(od, cia.IDENTITY, cia.IDENTITY_VENDOR),
            product=number_at(od, cia.IDENTITY, cia.IDENTITY_PRODUCT),
            revision=number_at(od, cia.IDENTITY, cia.IDENTITY_REVISION),
            serial=number_at(od, cia.IDENTITY, cia.IDENTITY_SERIAL),
        ),
        configuration=configuration(od, window_us=window_us),
        heartbeat_ns=number_at(od, cia.HEARTBEAT_PRODUCER) * 1_000_000,
    )


def foreign_write(request: bytes) -> str:
    """Return what an SDO request (8 bytes) writes, if the pipeline depends on that object, else nothing."""
    if len(request) < HEAD.size or request[0] >> 5 not in DOWNLOADS:
        return ""
    _, index, sub = HEAD.unpack_from(request)
    return f"0x{index:04X}:{sub:02X}" if is_verified(index) else ""


LOAD: Final = cia.SIGNATURE_LOAD.to_bytes(4, "little")
SAVE: Final = cia.SIGNATURE_SAVE.to_bytes(4, "little")

NO_VALUE: Final = (cia.AbortCode.WRITE_ONLY, cia.AbortCode.NO_DATA)
"""Why a value that can be written may have none to read."""

EXPEDITED_4: Final = 0x43
"""First byte of the answer to an upload of four bytes."""

BOARDS_FACTOR: Final = 15.0
"""An answer is awaited for 0.3 s, another for a quarter of that: a board takes up to 50 ms for one."""

ROUNDS: Final = 2
"""Times a configuration is downloaded, or what is then found to differ: the second is the last."""


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
    DOUBLED = "doubled"
    """Two boards answer under its node-ID."""
    RESTORED = "restored"
    """Its defaults are restored: it has to be reset, and provisioned again."""

    @property
    def is_good(self) -> bool:
        """Whether nothing is left to do."""
        return self in (Provision.SAME, Provision.CHANGED)


class Answering(NamedTuple):
    """Serial numbers (0x1018:04) of the boards that answer under one node-ID."""

    serials: tuple[int, ...]

    def __str__(self) -> str:
        numbers = " and ".join(str(serial) for serial in self.serials)
        return f"{len(self.serials)} boards answer under this node-ID: serial numbers {numbers}"


class Change(NamedTuple):
    """One value of a patch that differs from what is asked for; ``old`` is None when it cannot be read."""

    index: int  # type: ignore[assignment]  # hides tuple.index, which is not used here
    sub: int
    old: bytes | None
    new: bytes


@dataclass(frozen=True, slots=True)
class Provisioned:
    """What came of one patch, why, and what changed."""

    outcome: Provision
    reason: str = ""
    changes: tuple[Change, ...] = ()
    """Values that differed, of those that were read."""
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


class _EndedError(Exception):
    """Provisioning ends here; raised inside of scripts only."""

    def __init__(self, outcome: Provision, reason: str, changes: tuple[Change, ...] = ()) -> None:
        super().__init__(reason)
        self.result = Provisioned(outcome, reason, changes)


def provision(plan: ExpectedNode, task: Task, *, is_restored: bool = False) -> Script[Provisioned]:
    """Check one patch and bring it to its configuration.

    ``is_restored``: its defaults have been restored since it was last good.
    """
    try:
        done = yield from _provision(plan, task, is_restored=is_restored)
        if task.asks_error and done.outcome.is_good:
            error = yield from ask_error()
            if error is None:
                return Provisioned(Provision.ABSENT, "error register")
            return replace(done, error=error)
    except _EndedError as ended:
        return ended.result
    return done


def _provision(plan: ExpectedNode, task: Task, *, is_restored: bool) -> Script[Provisioned]:
    configuration = plan.configuration
    yield from _check_identity(plan.identity)
    marks, n_surplus = [], 0
    for sub in (cia.VERIFY_DATE, cia.VERIFY_TIME):
        reply: Reply = yield Request(cia.VERIFY_CONFIGURATION, sub)
        if reply.is_silent:
            _fail("configuration date and time", reply)
        marks.append(int.from_bytes(reply.data, "little"))  # 0 of a device without 0x1020
        n_surplus = reply.n_surplus
    if n_surplus:
        boards = yield from ask_boards(plan.node_id)
        if len(boards.serials) > 1:
            return Provisioned(Provision.DOUBLED, str(boards))
    is_marked = marks == [configuration.date, configuration.time]
    is_foreign = any(marks) and not is_marked
    if is_foreign and task.writes:
        if not is_restored:
            reply = yield Request(cia.RESTORE_DEFAULTS, cia.STORE_ALL, LOAD)
            if not reply.abort:
                return Provisioned(Provision.RESTORED, "had a configuration that is not in the arm file")
            if reply.is_silent or not configuration.writes:
                _fail("restoring the defaults", reply)
        if not configuration.writes:
            return Provisioned(Provision.REFUSED, "keeps a configuration that is not in the arm file")
    differing: tuple[Change, ...] = ()
    if task.reads_all:
        differing = yield from _compare_all(configuration)
    elif is_marked:
        differing = yield from _verify(configuration)
    window = configuration.window
    is_window = window is not None and [change[:2] for change in differing] == [window[:2]]
    if window is not None and is_window and is_marked and task.writes and not task.stores:
        # A device takes back its marks when any parameter is written (CiA 301, 7.5.2.24): they are set again.
        yield from _write(window)
        if configuration.writes:
            yield from _mark(configuration)
        differing = ()
    if is_marked and not differing:
        return Provisioned(Provision.SAME, is_restored=is_restored)
    if not task.writes:
        reason = "holds a configuration that is not the arm file's" if is_foreign else ""
        return Provisioned(Provision.WOULD_CHANGE, reason, differing)
    writes = () if is_marked and not task.reads_all else configuration.writes
    done = yield from _download(configuration, writes, differing, task)
    return done if done.outcome is Provision.REFUSED else replace(done, is_restored=is_restored)


def _check_identity(identity: Identity) -> Script[None]:
    """Refuse another device; zero fits any, but the first object shows that the node is there."""
    checks = (
        (cia.DEVICE_TYPE, 0, identity.device_type, "device type"),
        (cia.IDENTITY, cia.IDENTITY_VENDOR, identity.vendor, "vendor"),
        (cia.IDENTITY, cia.IDENTITY_PRODUCT, identity.product, "product code"),
        (cia.IDENTITY, cia.IDENTITY_REVISION, identity.revision, "revision"),
        (cia.IDENTITY, cia.IDENTITY_SERIAL, identity.serial, "serial number"),
    )
    for index, sub, wanted, what in checks:
        if not wanted and index != cia.DEVICE_TYPE:
            continue
        reply: Reply = yield Request(index, sub)
        if reply.abort:
            _fail(what, reply)
        seen = int.from_bytes(reply.data, "little")
        if wanted and seen != wanted:
            raise _EndedError(Provision.REFUSED, f"{what} is 0x{seen:X}, wanted 0x{wanted:X}")


def ask_error() -> Script[int | None]:
    """Return the EMCY code of a patch's last error; 0 for none, GENERIC for any, None: no answer."""
    reply: Reply = yield Request(cia.ERROR_REGISTER, 0)
    if reply.is_silent:
        return None
    if reply.abort or not any(reply.data):
        return cia.EmcyCode.NO_ERROR
    reply = yield Request(cia.ERROR_HISTORY, cia.LAST_ERROR)
    if reply.is_silent:
        return None
    code = 0 if reply.abort else int.from_bytes(reply.data[:2], "little")
    return code or cia.EmcyCode.GENERIC


def ask_boards(node_id: int) -> Script[Answering]:
    """Return the boards that answer under a node-ID: one request, and all answers to it."""
    head = HEAD.pack(ASK_UPLOAD, cia.IDENTITY, cia.IDENTITY_SERIAL)
    request = Frame(cia.SDO_CLIENT_BASE + node_id, head + bytes(4))
    answers: list[bytes] = yield Exchange(
        (request,), cia.SDO_SERVER_BASE + node_id, EXPEDITED_4, timeout_factor=BOARDS_FACTOR, awaits_all=True
    )
    numbers = [int.from_bytes(data[4:8], "little") for data in answers if data[1:4] == head[1:]]
    return Answering(tuple(sorted(numbers)))


def final_values(writes: Iterable[Write]) -> dict[tuple[int, int], bytes]:
    """Return what a patch is to hold after these downloads, by index and sub-index."""
    return {(write.index, write.sub): write.data for write in writes}


def _verify(configuration: Configuration) -> Script[tuple[Change, ...]]:
    """Return which objects that the pipeline depends on differ; one transfer, of a board with a checksum.

    Neither can another tool evade: the checksum is of what is held now, 0x1020 of what was configured once.
    """
    if configuration.checksum_index:
        reply: Reply = yield Request(configuration.checksum_index, 0)
        if reply.is_silent:
            _fail("communication checksum", reply)
        held = None if reply.abort else int.from_bytes(reply.data, "little")
        if held == configuration.checksum:
            return ()
        window = configuration.window
        if window is not None and held == configuration.checksum_before:
            return (Change(window.index, window.sub, bytes(4), window.data),)
    return (yield from _compare(final_values(configuration.communication), skips_missing=True))


def _compare_all(
    configuration: Configuration, unreadable: Container[tuple[int, int]] = ()
) -> Script[tuple[Change, ...]]:
    """Return which values of the configuration differ, and which objects that the pipeline depends on."""
    values = {key: v for key, v in final_values(configuration.writes).items() if key not in unreadable}
    configured = yield from _compare(values)
    verified = yield from _verify(configuration)
    return tuple(dict.fromkeys([*configured, *verified]))


def _compare(
    values: Mapping[tuple[int, int], bytes], *, skips_missing: bool = False
) -> Script[tuple[Change, ...]]:
    """Return which values that a patch holds differ; ``skips_missing``: objects of its EDS may be missing."""
    changes = []
    for (index, sub), new in values.items():
        reply: Reply = yield Request(index, sub)
        if skips_missing and reply.abort in (cia.AbortCode.NO_OBJECT, cia.AbortCode.NO_SUB_INDEX):
            continue
        if reply.abort not in (0, *NO_VALUE):
            _fail(f"read 0x{index:04X}:{sub:02X}", reply)
        old = None if reply.abort else reply.data
        if old is None or _relevant(index, sub, old) != _relevant(index, sub, new):
            changes.append(Change(index, sub, old, new))
    return tuple(changes)


def _relevant(index: int, sub: int, data: bytes) -> bytes | int:
    """Return what is compared of a value: bit 30 of a PDO's COB-ID (no RTR) changes nothing here."""
    is_cob_id = cia.TPDO_COMMUNICATION <= index < cia.TPDO_MAPPING and sub == cia.PDO_COB_ID
    return int.from_bytes(data, "little") & ~cia.COB_ID_NO_RTR if is_cob_id else data


def _download(
    configuration: Configuration, writes: Sequence[Write], changes: tuple[Change, ...], task: Task
) -> Script[Provisioned]:
    """Download in the order that devices take, verify, mark and store; ``changes`` differed before."""
    unreadable = {(change.index, change.sub) for change in changes if change.old is None}
    writes = [*writes, *_repairs(configuration, changes)]
    n_written = 0
    left: tuple[Change, ...] = ()
    try:
        for _ in range(ROUNDS):
            n_written += len(writes)
            for write in writes:
                yield from _write(write)
            if task.reads_all:
                left = yield from _compare_all(configuration, unreadable)
            else:
                left = yield from _verify(configuration)
            writes = _repairs(configuration, left)
            if not writes:
                break
        if left:
            index, sub, seen, wanted = left[0]
            text = f"reads {seen.hex(' ') if seen else 'nothing'} after {wanted.hex(' ')} was written"
            raise _EndedError(Provision.REFUSED, f"0x{index:04X}:{sub:02X} {text}")
        if configuration.writes or task.stores:
            yield from _mark(configuration)
    except _EndedError as ended:
        return replace(ended.result, changes=changes)
    if task.stores:
        reply: Reply = yield Request(cia.STORE_PARAMETERS, cia.STORE_ALL, SAVE)
        if reply.abort:
            return Provisioned(Provision.NOT_STORED, cia.describe_abort(reply.abort), changes, n_written)
    return Provisioned(Provision.CHANGED, "", changes, n_written)


def _write(write: Write) -> Script[None]:
    reply: Reply = yield Request(*write)
    if reply.abort:
        _fail(f"write 0x{write.index:04X}:{write.sub:02X}", reply)


def _mark(configuration: Configuration) -> Script[None]:
    """Write the marks."""
    marks = ((cia.VERIFY_DATE, configuration.date), (cia.VERIFY_TIME, configuration.time))
    for sub, mark in marks:
        reply: Reply = yield Request(cia.VERIFY_CONFIGURATION, sub, mark.to_bytes(4, "little"))
        if reply.is_silent:  # a device without 0x1020 is configured at every boot
            _fail("configuration date and time", reply)


def _repairs(configuration: Configuration, changes: Iterable[Change]) -> list[Write]:
    return repairs(configuration, {(c.index, c.sub): c.old for c in changes if is_verified(c.index)})


def _fail(what: str, reply: Reply) -> NoReturn:
    outcome = Provision.ABSENT if reply.is_silent else Provision.REFUSED
    raise _EndedError(outcome, f"{what}: {cia.describe_abort(reply.abort)}")
