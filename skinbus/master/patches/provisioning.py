"""Provisioning of one patch (after CiA 302-2): is it the device the arm file asks for, and is it configured.

The master runs it at every boot of a patch; ``skinbus configure`` runs the same script with every value read
back and stored. A patch that holds a configuration of another arm file gets its defaults back first: what the
arm file does not name must not stay behind.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from enum import Enum, StrEnum, auto
from typing import NamedTuple

from canopen.objectdictionary import ObjectDictionary

from skinbus.can.frame import Frame
from skinbus.master.commissioning.sessions import Listen, NodesCore, Reply, Request, Script, Timeouts
from skinbus.model import Arm
from skinbus.node.nmt import nmt_frame
from skinbus.node.sdo_client import ASK_UPLOAD
from skinbus.node.sdo_server import HEAD
from skinbus.objects import cia
from skinbus.objects.dcf import Configuration, Write, configuration, is_verified, repairs
from skinbus.objects.profile import number_at

NUMBERS = (
    ("device_type", cia.DEVICE_TYPE, 0),
    ("vendor", cia.IDENTITY, cia.IDENTITY_VENDOR),
    ("product", cia.IDENTITY, cia.IDENTITY_PRODUCT),
    ("revision", cia.IDENTITY, cia.IDENTITY_REVISION),
    ("serial", cia.IDENTITY, cia.IDENTITY_SERIAL),
)
"""The numbers of an identity, and where they are."""

IN_WORDS = {"device_type": "device type", "product": "product code", "serial": "serial number"}


class Identity(NamedTuple):
    """Identity of a patch; zero means that any value will do (CiA 302-2, 0x1F84-0x1F88)."""

    device_type: int = 0
    vendor: int = 0
    product: int = 0
    revision: int = 0
    serial: int = 0


class ExpectedNode(NamedTuple):
    """What the master expects of a patch; ``heartbeat_ns`` is the period of its heartbeat, 0 for none."""

    node_id: int
    identity: Identity
    configuration: Configuration
    heartbeat_ns: int = 0


def expected_nodes(arm: Arm, ods: Sequence[ObjectDictionary]) -> list[ExpectedNode]:
    """Return what the master expects of the patches of an arm, by their dictionaries."""
    window_us = round(1e6 / arm.bus.rate_hz)
    nodes = zip(arm.node_id.tolist(), ods, strict=True)
    return [expected_node(node_id, od, window_us=window_us) for node_id, od in nodes]


def expected_node(node_id: int, od: ObjectDictionary, *, window_us: int = 0) -> ExpectedNode:
    """Return what the EDS of a patch asks for; an identity left out or zero is not checked.

    ``window_us`` is the period of the SYNC: TPDOs of a patch that are later than that it is not to send.
    """
    return ExpectedNode(
        node_id=node_id,
        identity=Identity(*(number_at(od, index, sub) for _, index, sub in NUMBERS)),
        configuration=configuration(od, window_us=window_us),
        heartbeat_ns=number_at(od, cia.HEARTBEAT_PRODUCER) * 1_000_000,
    )


DOWNLOADS = (1, 6)
"""Client command specifiers that begin a download, in segments and in blocks."""


def foreign_write(request: bytes, others: Container[int] = ()) -> str:
    """Return what an SDO request (8 bytes) writes, if the pipeline depends on that object, else nothing.

    ``others``: indices of objects on which it does in this arm.
    """
    if len(request) < HEAD.size or request[0] >> 5 not in DOWNLOADS:
        return ""
    _, index, sub = HEAD.unpack_from(request)
    return f"0x{index:04X}:{sub:02X}" if is_verified(index) or index in others else ""


LOAD = cia.SIGNATURE_LOAD.to_bytes(4, "little")
SAVE = cia.SIGNATURE_SAVE.to_bytes(4, "little")

NO_VALUE: tuple[int, ...] = (cia.AbortCode.WRITE_ONLY, cia.AbortCode.NO_DATA)
"""Why a value that can be written may have none to read."""
MISSING: tuple[int, ...] = (cia.AbortCode.NO_OBJECT, cia.AbortCode.NO_SUB_INDEX)
ANY = range(1 << 32)
"""All abort codes."""

EXPEDITED_4 = 0x43
"""First byte of the answer to an upload of four bytes."""

BOARDS_NS = 300_000_000
"""For so long an answer is awaited, and a quarter of that for another: a board takes up to 50 ms for one."""

ROUNDS = 2
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


Changes = tuple[Change, ...]


class Provisioned(NamedTuple):
    """What came of one patch, why, and what changed."""

    outcome: Provision
    reason: str = ""
    changes: Changes = ()
    """Values that differed, of those that were read."""
    n_written: int = 0
    """Objects downloaded."""
    is_restored: bool = False
    """Its defaults were restored, since it held a configuration of another arm file."""
    error: int = 0
    """EMCY code of its last error, if that was asked for; 0 for none."""


class Task(Enum):
    """How far provisioning goes."""

    BOOT = auto()
    """Marks and checksum decide what is written; last its errors are read: an EMCY may be lost."""
    CONFIGURE = auto()
    """Every value is read before and after the download, and all is stored."""
    COMPARE = auto()
    """Every value is read, nothing is written."""


class _EndedError(Exception):
    """Provisioning ends here; raised inside of scripts only."""

    def __init__(self, outcome: Provision, reason: str) -> None:
        super().__init__(reason)
        self.result = Provisioned(outcome, reason)


def provision(
    plan: ExpectedNode, task: Task, *, is_restored: bool = False, guard: Script[None] | None = None
) -> Script[Provisioned]:
    """Check one patch and bring it to its configuration.

    ``is_restored``: its defaults have been restored since it was last good; ``guard`` follows at a boot.
    """
    try:
        done = yield from _provision(plan, task, is_restored=is_restored)
        if task is Task.BOOT and done.outcome.is_good:
            if guard is not None:
                yield from guard
            return done._replace(error=(yield from _last_error()))
    except _EndedError as ended:
        return ended.result
    return done


def _provision(plan: ExpectedNode, task: Task, *, is_restored: bool) -> Script[Provisioned]:
    asked = plan.configuration
    writes = task is not Task.COMPARE
    yield from _check_identity(plan.identity)
    marks, n_surplus = [], 0
    for sub in (cia.VERIFY_DATE, cia.VERIFY_TIME):
        reply = yield from _ask("configuration date and time", cia.VERIFY_CONFIGURATION, sub, tolerates=ANY)
        marks.append(int.from_bytes(reply.data, "little"))  # 0 of a device without 0x1020
        n_surplus = reply.n_surplus
    if n_surplus:
        boards = yield from ask_boards(plan.node_id)
        if len(boards.serials) > 1:
            return Provisioned(Provision.DOUBLED, str(boards))
    is_marked = marks == [asked.date, asked.time]
    is_foreign = any(marks) and not is_marked
    if is_foreign and writes:
        if not is_restored:
            tolerates = ANY if asked.writes else ()
            reply = yield from _ask(
                "restoring the defaults", cia.RESTORE_DEFAULTS, cia.STORE_ALL, LOAD, tolerates=tolerates
            )
            if not reply.abort:
                return Provisioned(Provision.RESTORED, "had a configuration that is not in the arm file")
        if not asked.writes:
            return Provisioned(Provision.REFUSED, "keeps a configuration that is not in the arm file")
    differing: Changes = ()
    if task is not Task.BOOT:
        differing = yield from _compare_all(asked)
    elif is_marked:
        differing = yield from _verify(asked)
    window = asked.window
    if window and is_marked and task is Task.BOOT and [change[:2] for change in differing] == [window[:2]]:
        # A device takes back its marks when any parameter is written (CiA 301, 7.5.2.24): they are set again.
        yield from _write(window)
        if asked.writes:
            yield from _mark(asked)
        differing = ()
    if is_marked and not differing:
        return Provisioned(Provision.SAME, is_restored=is_restored)
    if not writes:
        reason = "holds a configuration that is not the arm file's" if is_foreign else ""
        return Provisioned(Provision.WOULD_CHANGE, reason, differing)
    done = yield from _download(asked, differing, task, is_marked=is_marked)
    return done if done.outcome is Provision.REFUSED else done._replace(is_restored=is_restored)


def _ask(
    what: str, index: int, sub: int, data: bytes | None = None, *, tolerates: Container[int] = ()
) -> Script[Reply]:
    """Return the reply to a request; silence ends provisioning, and so does another abort than tolerated."""
    reply: Reply = yield Request(index, sub, data)
    if reply.is_silent or (reply.abort and reply.abort not in tolerates):
        outcome = Provision.ABSENT if reply.is_silent else Provision.REFUSED
        raise _EndedError(outcome, f"{what}: {cia.describe_abort(reply.abort)}")
    return reply


def _check_identity(identity: Identity) -> Script[None]:
    """Refuse another device; zero fits any, but the first object shows that the node is there."""
    for (name, index, sub), wanted in zip(NUMBERS, identity, strict=True):
        if wanted or index == cia.DEVICE_TYPE:
            what = IN_WORDS.get(name, name)
            seen = int.from_bytes((yield from _ask(what, index, sub)).data, "little")
            if wanted not in (0, seen):
                raise _EndedError(Provision.REFUSED, f"{what} is 0x{seen:X}, wanted 0x{wanted:X}")


def write_back(what: str, index: int, sub: int, data: bytes) -> Script[None]:
    """Write a value, or none, and read it back; a patch that does not hold it then is refused."""
    yield from _ask(what, index, sub, data)
    if (yield from _ask(what, index, sub, tolerates=() if data else NO_VALUE)).data != data:
        raise _EndedError(Provision.REFUSED, f"{what}: others are read than were written")


def by_itself(script: Script[None]) -> Script[Provisioned | None]:
    """Run a part of provisioning; return why it failed, if it did."""
    try:
        yield from script
    except _EndedError as ended:
        return ended.result
    return None


def _last_error() -> Script[int]:
    """Return the EMCY code of a patch's last error; 0 for none, GENERIC for any."""
    what = "error register"
    if not any((yield from _ask(what, cia.ERROR_REGISTER, 0, tolerates=ANY)).data):
        return cia.EmcyCode.NO_ERROR
    reply = yield from _ask(what, cia.ERROR_HISTORY, cia.LAST_ERROR, tolerates=ANY)
    return int.from_bytes(reply.data[:2], "little") or cia.EmcyCode.GENERIC


def ask_boards(node_id: int) -> Script[Answering]:
    """Return the boards that answer under a node-ID: one request, and all answers to it."""
    head = HEAD.pack(ASK_UPLOAD, cia.IDENTITY, cia.IDENTITY_SERIAL)
    request = Frame(cia.SDO_CLIENT_BASE + node_id, head + bytes(4))

    def is_answer(frame: Frame) -> bool:
        return frame.data[:4] == bytes([EXPEDITED_4]) + head[1:]

    answers: list[Frame] = yield Listen(BOARDS_NS, is_answer, (request,), BOARDS_NS // 4)
    numbers = [int.from_bytes(frame.data[4:8], "little") for frame in answers if is_answer(frame)]
    return Answering(tuple(sorted(numbers)))


def final_values(writes: Iterable[Write]) -> dict[tuple[int, int], bytes]:
    """Return what a patch is to hold after these downloads, by index and sub-index."""
    return {(write.index, write.sub): write.data for write in writes}


def _verify(asked: Configuration) -> Script[Changes]:
    """Return which objects that the pipeline depends on differ; one transfer, of a board with a checksum.

    Neither can another tool evade: the checksum is of what is held now, 0x1020 of what was configured once.
    """
    if asked.checksum_index:
        reply = yield from _ask("communication checksum", asked.checksum_index, 0, tolerates=ANY)
        held = None if reply.abort else int.from_bytes(reply.data, "little")
        if held == asked.checksum:
            return ()
        if asked.window is not None and held == asked.checksum_before:
            return (Change(asked.window.index, asked.window.sub, bytes(4), asked.window.data),)
    return (yield from _compare(final_values(asked.communication), MISSING))


def _compare_all(asked: Configuration, unreadable: Container[tuple[int, int]] = ()) -> Script[Changes]:
    """Return which values of the configuration differ, and which objects that the pipeline depends on."""
    values = {key: v for key, v in final_values(asked.writes).items() if key not in unreadable}
    configured = yield from _compare(values)
    verified = yield from _verify(asked)
    return tuple(dict.fromkeys([*configured, *verified]))


def _compare(values: Mapping[tuple[int, int], bytes], skipped: tuple[int, ...] = ()) -> Script[Changes]:
    """Return which values that a patch holds differ; those that it aborts with a ``skipped`` code do not."""
    changes = []
    for (index, sub), new in values.items():
        tolerates = (*NO_VALUE, *skipped)
        reply = yield from _ask(f"read 0x{index:04X}:{sub:02X}", index, sub, tolerates=tolerates)
        if reply.abort and reply.abort in skipped:
            continue
        old = None if reply.abort else reply.data
        if old is None or _relevant(index, sub, old) != _relevant(index, sub, new):
            changes.append(Change(index, sub, old, new))
    return tuple(changes)


def _relevant(index: int, sub: int, data: bytes) -> bytes | int:
    """Return what is compared of a value: bit 30 of a PDO's COB-ID (no RTR) changes nothing here."""
    is_cob_id = cia.TPDO_COMMUNICATION <= index < cia.TPDO_MAPPING and sub == cia.PDO_COB_ID
    return int.from_bytes(data, "little") & ~cia.COB_ID_NO_RTR if is_cob_id else data


def _download(asked: Configuration, changes: Changes, task: Task, *, is_marked: bool) -> Script[Provisioned]:
    """Download in the order that devices take, verify, mark and store; ``changes`` differed before."""
    unreadable = {(change.index, change.sub) for change in changes if change.old is None}
    writes = [*asked.writes * (task is Task.CONFIGURE or not is_marked), *_repairs(asked, changes)]
    n_written, left = 0, changes
    try:
        for _ in range(ROUNDS):
            n_written += len(writes)
            for write in writes:
                yield from _write(write)
            left = yield from (_compare_all(asked, unreadable) if task is Task.CONFIGURE else _verify(asked))
            writes = _repairs(asked, left)
            if not writes:
                break
        if left:
            index, sub, seen, wanted = left[0]
            text = f"reads {seen.hex(' ') if seen else 'nothing'} after {wanted.hex(' ')} was written"
            raise _EndedError(Provision.REFUSED, f"0x{index:04X}:{sub:02X} {text}")
        if asked.writes or task is Task.CONFIGURE:
            yield from _mark(asked)
    except _EndedError as ended:
        return ended.result._replace(changes=changes)
    if task is Task.CONFIGURE:
        reply: Reply = yield Request(cia.STORE_PARAMETERS, cia.STORE_ALL, SAVE)
        if reply.abort:
            return Provisioned(Provision.NOT_STORED, cia.describe_abort(reply.abort), changes, n_written)
    return Provisioned(Provision.CHANGED, "", changes, n_written)


def _write(write: Write) -> Script[None]:
    yield from _ask(f"write 0x{write.index:04X}:{write.sub:02X}", *write)


def _mark(asked: Configuration) -> Script[None]:
    """Write the marks; a device without 0x1020 is configured at every boot."""
    for sub, mark in ((cia.VERIFY_DATE, asked.date), (cia.VERIFY_TIME, asked.time)):
        data = mark.to_bytes(4, "little")
        yield from _ask("configuration date and time", cia.VERIFY_CONFIGURATION, sub, data, tolerates=ANY)


def _repairs(asked: Configuration, changes: Iterable[Change]) -> list[Write]:
    return repairs(asked, {(c.index, c.sub): c.old for c in changes if is_verified(c.index)})


TRIES = 3
"""Times a patch is asked whether it is there: at 0.3 s each, longer than a board takes to start."""

LISTEN_NS = 300_000_000
"""Before anything is sent, the bus is listened to for so long: SYNC means that a master is at work."""

REBOOT_NS = 2_000_000_000
"""Longest time from the reset of a patch to its boot-up message."""


class Configurer(NodesCore[Provisioned]):
    """A core that configures all patches of ``plans`` and then asks its host to stop.

    ``results`` fills up by node-ID. Where another master is at work nothing is sent.
    """

    def __init__(
        self, plans: Sequence[ExpectedNode], *, dry_run: bool = False, timeouts: Timeouts | None = None
    ) -> None:
        self._plans = {plan.node_id: plan for plan in plans}
        self._task = Task.COMPARE if dry_run else Task.CONFIGURE
        super().__init__(self._plans, timeouts, listens_ns=LISTEN_NS)

    def _script(self, node_id: int) -> Script[Provisioned]:
        plan = self._plans[node_id]
        if self._task is Task.CONFIGURE:
            yield from _reset(node_id)
        for _ in range(TRIES):
            result = yield from provision(plan, self._task)
            if result.outcome is Provision.RESTORED:
                yield from _reset(node_id)
                result = yield from provision(plan, self._task, is_restored=True)
            if result.outcome is not Provision.ABSENT or result.changes:
                break
        return result


def _reset(node_id: int) -> Script[None]:
    """Let a patch hold what it has stored, and send no readings, whose meaning may change."""
    for command, ns in ((cia.NmtCommand.RESET_NODE, REBOOT_NS), (cia.NmtCommand.PRE_OPERATIONAL, 0)):
        yield Listen(ns, lambda frame: frame.data == b"\0", (nmt_frame(command, node_id),))
