"""Configuration of the patches of an arm: compared, applied, read back and stored, all side by side.

Per patch: its identity is checked; what it holds is read; if that is not what the arm file asks for, it is
downloaded, read back, marked in 0x1020 and stored by 0x1010. A patch that holds a configuration of somebody
else's gets its defaults back first: what the arm file no longer names must not stay behind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple

from skinbus.can.core import NEVER, STOP, Event, Step
from skinbus.can.frame import Frame
from skinbus.master.commissioning.sdo_sessions import Reply, Request, Script, SdoSessions
from skinbus.master.patches.expected_nodes import ExpectedNode
from skinbus.master.patches.provisioning import LOAD, Ending, check_identity
from skinbus.node.nmt import nmt_frame
from skinbus.objects import cia

SAVE: Final = cia.SIGNATURE_SAVE.to_bytes(4, "little")

TRIES: Final = 3
"""Times a patch is asked whether it is there: at 0.3 s each, longer than a board takes to start."""

LISTEN_NS: Final = 300_000_000
"""Before anything is sent, the bus is listened to for so long: a SYNC means that a master is at work."""

MASTER_HEARD: Final = "master-heard"
"""Kind of the event, the last one, by which a master at work is reported: two of them would talk at once."""

REBOOT_NS: Final = 2_000_000_000
"""Longest time from the reset of a patch to its boot-up message."""

REMOTE_ABORTS: Final = (cia.AbortCode.WRITE_ONLY, cia.AbortCode.NO_DATA)
"""Why a value that can be written may have none to read."""


class Outcome(StrEnum):
    """What came of one patch."""

    SAME = "as asked"
    """It held everything already."""
    CHANGED = "changed"
    """It holds everything now, and has stored it."""
    WOULD_CHANGE = "would change"
    """It differs; nothing was written."""
    NOT_STORED = "not stored"
    """It holds everything, until it is switched off."""
    REFUSED = "refused"
    """Another device, or it did not take a value."""
    ABSENT = "absent"
    """It did not answer, or stopped answering."""

    @property
    def is_good(self) -> bool:
        """Whether nothing is left to do."""
        return self in (Outcome.SAME, Outcome.CHANGED)


class Change(NamedTuple):
    """One value of a patch that differs from what is asked for; ``old`` is None when it cannot be read."""

    index: int  # type: ignore[assignment]  # hides tuple.index, which nobody wants here
    sub: int
    old: bytes | None
    new: bytes


@dataclass(frozen=True, slots=True)
class Result:
    """What came of one patch, why, and what changed."""

    outcome: Outcome
    reason: str = ""
    changes: tuple[Change, ...] = ()
    restored: bool = False
    """Its defaults were restored, since it held a configuration of somebody else's."""


class _Restored(NamedTuple):
    """A script has ended because the patch has to be reset before the next one."""


def configure(plan: ExpectedNode, *, dry_run: bool, restored: bool = False) -> Script[Result | _Restored]:
    """Bring one patch to what its plan says; with ``dry_run``, only say what differs."""
    refusal = yield from check_identity(plan.identity)
    if refusal is not None:
        absent = refusal.ending is Ending.NO_ANSWER
        return Result(Outcome.ABSENT if absent else Outcome.REFUSED, refusal.reason)
    marks = yield from _read_marks()
    wanted_marks = (plan.configuration.date, plan.configuration.time)
    is_foreign = any(marks) and marks != wanted_marks
    if is_foreign and not (dry_run or restored):
        reply = yield Request(cia.RESTORE_DEFAULTS, cia.STORE_ALL, LOAD)
        if not reply.abort:
            return _Restored()
        if not plan.configuration.writes:
            return _failed("restore the defaults", reply)
    changes: list[Change] = []
    for (index, sub), new in final_values(plan).items():
        reply = yield Request(index, sub)
        if reply.abort not in (0, *REMOTE_ABORTS):
            return _failed(f"read 0x{index:04X}:{sub:02X}", reply)
        old = None if reply.abort else reply.data
        if old != new:
            changes.append(Change(index, sub, old, new))
    seen = tuple(changes)
    if not seen and marks == wanted_marks:
        return Result(Outcome.SAME, restored=restored)
    if dry_run:
        reason = "holds a configuration that is not the arm file's" if is_foreign else ""
        return Result(Outcome.WOULD_CHANGE, reason, seen)
    return (yield from _apply(plan, seen, restored=restored))


def final_values(plan: ExpectedNode) -> dict[tuple[int, int], bytes]:
    """Return what a patch is to hold when all has been downloaded, by index and sub-index."""
    return {(write.index, write.sub): write.data for write in plan.configuration.writes}


def _apply(plan: ExpectedNode, changes: tuple[Change, ...], *, restored: bool) -> Script[Result | _Restored]:
    """Download all in the order that devices take, read back what can be read, mark and store."""
    for index, sub, data in plan.configuration.writes:
        reply = yield Request(index, sub, data)
        if reply.abort:
            return _failed(f"write 0x{index:04X}:{sub:02X}", reply, changes)
    unreadable = {(change.index, change.sub) for change in changes if change.old is None}
    for (index, sub), wanted in final_values(plan).items():
        if (index, sub) in unreadable:
            continue
        reply = yield Request(index, sub)
        if reply.abort:
            return _failed(f"read back 0x{index:04X}:{sub:02X}", reply, changes)
        if reply.data != wanted:
            reason = (
                f"0x{index:04X}:{sub:02X} reads {reply.data.hex(' ')} after {wanted.hex(' ')} was written"
            )
            return Result(Outcome.REFUSED, reason, changes)
    marks = ((cia.VERIFY_DATE, plan.configuration.date), (cia.VERIFY_TIME, plan.configuration.time))
    for sub, mark in marks:
        yield Request(cia.VERIFY_CONFIGURATION, sub, mark.to_bytes(4, "little"))  # it may not have the object
    reply = yield Request(cia.STORE_PARAMETERS, cia.STORE_ALL, SAVE)
    if reply.abort:
        return Result(Outcome.NOT_STORED, cia.describe_abort(reply.abort), changes, restored)
    return Result(Outcome.CHANGED, "", changes, restored)


def _read_marks() -> Script[tuple[int, int]]:
    """Return date and time of 0x1020, 0 for what the patch does not have."""
    date = yield Request(cia.VERIFY_CONFIGURATION, cia.VERIFY_DATE)
    time = yield Request(cia.VERIFY_CONFIGURATION, cia.VERIFY_TIME)
    return int.from_bytes(date.data, "little"), int.from_bytes(time.data, "little")


def _failed(what: str, reply: Reply, changes: tuple[Change, ...] = ()) -> Result:
    outcome = Outcome.ABSENT if reply.abort == cia.AbortCode.TIMEOUT else Outcome.REFUSED
    return Result(outcome, f"{what}: {cia.describe_abort(reply.abort)}", changes)


class Configurer:
    """A core that configures all patches of ``plans`` and then asks its host to stop.

    ``results`` fills up by node-ID; ``progress`` is the share of the work that is done.
    """

    def __init__(
        self,
        plans: Sequence[ExpectedNode],
        *,
        dry_run: bool = False,
        on_result: Callable[[int, Result], object] | None = None,
    ) -> None:
        self.results: dict[int, Result] = {}
        self._plans = {plan.node_id: plan for plan in plans}
        self._dry_run = dry_run
        self._on_result = on_result
        self._sessions: SdoSessions[Result | _Restored] = SdoSessions()
        self._tries = dict.fromkeys(self._plans, TRIES)
        self._rebooting: dict[int, int] = {}
        self._requests = dict.fromkeys(self._plans, 0)
        self._answer = {cia.SDO_SERVER_BASE + node_id: node_id for node_id in self._plans}
        self._boot_up = {cia.HEARTBEAT_BASE + node_id: node_id for node_id in self._plans}
        self.cob_ids = frozenset(self._answer) | frozenset(self._boot_up) | {cia.SYNC_ID}
        self._begin_at: int | None = None
        self._started = False

    @property
    def progress(self) -> float:
        """Share of the work that is done, 0 to 1; an estimate."""
        done = sum(
            1.0 if node_id in self.results else min(0.99, self._requests[node_id] / _n_requests(plan))
            for node_id, plan in self._plans.items()
        )
        return done / len(self._plans) if self._plans else 1.0

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Take frames up to now; return frames to send, events, and the time of the next wake-up."""
        out: list[Frame] = []
        events: list[Event] = []
        if self._begin_at is None:
            self._begin_at = now_ns + LISTEN_NS
        if not self._started:
            if any(frame.can_id == cia.SYNC_ID for frame in frames):
                heard = [Event(t_ns=now_ns, kind=kind) for kind in (MASTER_HEARD, STOP)]
                return Step((), heard, NEVER)
            if now_ns < self._begin_at:
                return Step((), (), self._begin_at)
            self._started = True
            for node_id in self._plans:
                if not self._dry_run:  # nobody's readings are to run into a change of what they are
                    out.append(nmt_frame(cia.NmtCommand.PRE_OPERATIONAL, node_id))
                self._begin(now_ns, node_id, out)
        answers: dict[int, list[Frame]] = {}
        for frame in frames:
            if (answering := self._answer.get(frame.can_id)) is not None:
                answers.setdefault(answering, []).append(frame)
                self._requests[answering] += 1
            elif self._boot_up.get(frame.can_id) in self._rebooting and frame.data == b"\0":
                booted = self._boot_up[frame.can_id]
                del self._rebooting[booted]
                self._begin(now_ns, booted, out, restored=True)
        requests, ended = self._sessions.step(now_ns, answers)
        out += requests
        for node_id, result in ended:
            self._conclude(now_ns, node_id, result, out)
        for node_id in [n for n, until_ns in self._rebooting.items() if until_ns <= now_ns]:
            del self._rebooting[node_id]
            self._begin(now_ns, node_id, out, restored=True)  # perhaps it sends no boot-up message
        if len(self.results) == len(self._plans):
            events.append(Event(t_ns=now_ns, kind=STOP))
        return Step(out, events, min(self._sessions.wake_ns, min(self._rebooting.values(), default=NEVER)))

    def _begin(self, now_ns: int, node_id: int, out: list[Frame], *, restored: bool = False) -> None:
        script = configure(self._plans[node_id], dry_run=self._dry_run, restored=restored)
        out += self._sessions.begin(now_ns, node_id, node_id, script)

    def _conclude(self, now_ns: int, node_id: int, result: Result | _Restored, out: list[Frame]) -> None:
        if isinstance(result, _Restored):
            out.append(nmt_frame(cia.NmtCommand.RESET_NODE, node_id))
            self._rebooting[node_id] = now_ns + REBOOT_NS
            return
        if result.outcome is Outcome.ABSENT and not result.changes:
            self._tries[node_id] -= 1
            if self._tries[node_id] > 0:
                self._begin(now_ns, node_id, out)
                return
        self.results[node_id] = result
        if self._on_result:
            self._on_result(node_id, result)


def _n_requests(plan: ExpectedNode) -> int:
    """Return about how many SDO answers a patch gives until it is configured."""
    return 10 + len(plan.configuration.writes) + 2 * len(final_values(plan))
