"""Supervision: boots the patches side by side, watches their heartbeats, and recovers those that return.

The states of a patch and what leads from one to another are in ``table.TRANSITIONS``. Where another master
has booted the patches, ``PassiveMonitor`` takes the place of the supervisor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from skinbus.can.core import NEVER
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.master.commissioning.sessions import Script, Sessions, Timeouts
from skinbus.master.patches.provisioning import (
    Answering,
    ExpectedNode,
    Provision,
    Provisioned,
    Task,
    ask_boards,
    foreign_write,
    provision,
)
from skinbus.master.patches.table import Mask, PatchState, PatchTable
from skinbus.node.nmt import command_for, nmt_frame
from skinbus.objects import cia
from skinbus.objects.cia import AbortCode, EmcyCode, NmtCommand, NmtState

DELAYS_S = (0, 1, 2, 4, 8, 16, 30)
"""Delays between the starts of a patch that stops running soon after each, or between looks at a double
node-ID; the last one stays."""

STABLE_NS = 30_000_000_000
"""A patch that has run for so long is stable: its next restart is at once. No shorter than the longest delay,
so that one that fails once in each delay is not taken for a stable one."""

GRACE_NS = 100_000_000
"""A heartbeat that contradicts a command so soon after was under way before: two full buses long."""

HOLD_NS = 20_000_000
"""No patch is started so soon after the first boot-up message of another: on the wire these give way to SDO,
so those of many boards that start together come one by one; 20 frame times at 125 kbit/s."""

RETRY_NS = 1_000_000_000
"""Pause between attempts to reach a patch that does not answer: long against a boot."""

NAMED_NS = 1_000_000_000
"""After its start, when a patch is asked for its serial number: the start of many takes no longer for it."""

HEARTBEAT_FACTOR = 3.0
"""A patch is lost after this many heartbeat periods; the factor of lely's dcfgen (heartbeat_multiplier)."""

MUTE_NS = 5_000_000_000
"""A patch that lives but sends no readings for so long is reset: long against a boot and a passing fault."""

EMCY_LENGTH = 8

FIRST_ERROR = 0x0100
"""EMCY codes below report that an error was reset, or that there is none (CiA 301, table 26)."""

REFUSALS = {Provision.REFUSED: EventKind.PATCH_REFUSED, Provision.DOUBLED: EventKind.PATCH_DOUBLED}

Ended = Provisioned | Answering
"""What a session returned: of a boot, or of a question for the boards of a node-ID."""


N_DOUBTS = 3
"""Doubts about a board that need no second answer by SDO. A single frame may come twice: CAN repeats one of
which only the sender saw an error in the last bit."""

DOUBTS_NS = 10_000_000_000
"""Time within which they count."""


class Supervisor:
    """Owns the state of every patch; frames and time in, frames and events out.

    Readings of started patches would slow the boots of the others down: all that are there are started
    together. A patch is waited for once: one that reboots again and again delays no other.
    """

    def __init__(
        self, plans: Sequence[ExpectedNode], table: PatchTable, timeouts: Timeouts | None = None
    ) -> None:
        n = len(plans)
        self.table = table
        self._plans = tuple(plans)
        self._sessions: Sessions[Ended] = Sessions(timeouts)
        self._ready: list[int] = []  # booted, and not started yet
        self._hold_until = 0
        self._has_booted, self._is_restored, self._is_unnamed = np.zeros((3, n), np.bool_)
        self._retry_at, self._reset_at = np.full((2, n), NEVER)
        self._started_at, self._not_before = np.zeros((2, n), np.int64)
        self._n_unstable, self._n_doubled = np.zeros((2, n), np.int64)
        self._bad_length = np.zeros(n, np.int32)
        self._has_bad_length = np.zeros(n, np.bool_)
        self._is_lost = np.zeros(n, np.bool_)  # as the log has it: "back" follows
        self._doubts: dict[int, list[int]] = {}  # times at which its readings came twice
        self._requests: list[tuple[int | None, NmtCommand]] = []
        self._is_bus_lost = False
        self._out: list[Frame] = []
        self._events: list[Event] = []
        heartbeat_ns = np.array([plan.heartbeat_ns for plan in plans], np.int64)
        self._lost_after = (HEARTBEAT_FACTOR * heartbeat_ns).astype(np.int64)
        watched = self._lost_after[self._lost_after > 0]
        # Four times per time-out: a loss is detected at most a quarter of it late.
        self._watch_period = int(watched.min()) // 4 if len(watched) else NEVER
        self._next_watch = NEVER
        bases = (cia.SDO_SERVER_BASE, cia.HEARTBEAT_BASE, cia.EMCY_BASE, cia.SDO_CLIENT_BASE)
        self._sender = {base + plan.node_id: (base, p) for base in bases for p, plan in enumerate(plans)}
        """By identifier: which service of which patch."""
        self.cob_ids = frozenset(self._sender)

    def start(self, now_ns: int, *, is_first: bool) -> list[Frame]:
        """Begin: every node goes through its boot-up, whatever it was doing before.

        Only the first time by a broadcast: two masters would answer each other's for ever.
        """
        for p in np.flatnonzero(self.table.is_running).tolist():
            self.table.enter(p, PatchState.ABSENT)
        self._sessions.clear()
        self._ready.clear()
        self.table.error[:] = 0  # each patch is asked for its errors at its boot
        self._has_booted[:] = self._is_lost[:] = False
        self._n_unstable[:] = self._not_before[:] = 0
        self._retry_at[:] = now_ns + RETRY_NS
        self._reset_at[:] = NEVER
        self._next_watch = min(now_ns + self._watch_period, NEVER)
        is_asked = any(target is None for target, _ in self._requests)  # a client has all of them reset
        node_ids = [0] if is_first else [plan.node_id for plan in self._plans if not is_asked]
        return [nmt_frame(NmtCommand.RESET_COMMUNICATION, node_id) for node_id in node_ids]

    def bus_is_lost(self) -> None:
        """Suspend supervision until the bus is back: silence proves nothing about a patch now."""
        self._is_bus_lost = True

    def bus_is_back(self, now_ns: int) -> None:
        """Resume: no patch is late for what was lost, and what was asked then is asked again."""
        self._is_bus_lost, self.table.last_heard[:] = False, now_ns
        silent = self.table.state == PatchState.SILENT
        self._retry_at[silent], self._reset_at[silent] = NEVER, now_ns + MUTE_NS  # readings suffice
        unheard = np.array([p in self._sessions for p in range(len(self._plans))]) & ~self.table.is_running
        self._retry_at[(self._retry_at < NEVER) | unheard] = now_ns

    def request(self, p: int | None, command: NmtCommand) -> AbortCode | None:
        """Reset patch p, or all, with the next step, because a client asks for it; return why not."""
        self._requests.append((p, command))
        return None

    @property
    def wake_ns(self) -> int:
        """Time of the next thing to do (ns)."""
        if self._is_bus_lost:
            return NEVER
        if self._requests:
            return 0
        hold = self._hold_until if self._ready and not self._sessions.n_answering else NEVER
        due = int(self._retry_at.min()), int(self._reset_at.min()), self._next_watch
        return min(*due, self._sessions.wake_ns, hold)

    def step(self, now_ns: int, frames: Sequence[Frame]) -> tuple[list[Frame], list[Event]]:
        """Take control-plane frames; return frames to send, and events."""
        if self._is_bus_lost:
            return [], []
        answers: dict[int, list[Frame]] = {}
        has_sent_emcy: set[int] = set()
        for frame in frames:
            base, p = self._sender.get(frame.can_id, (0, 0))
            if base == cia.SDO_SERVER_BASE:
                answers.setdefault(p, []).append(frame)
            elif base == cia.HEARTBEAT_BASE and len(frame.data) == 1:
                self._heartbeat_of(now_ns, p, frame.data[0] & 0x7F)
            elif base == cia.EMCY_BASE and len(frame.data) == EMCY_LENGTH:
                has_sent_emcy.add(p)
                code, data = int.from_bytes(frame.data[:2], "little"), frame.data[3:]
                # Which error is over it does not say (CiA 301, 7.2.7.1): the last code stays until all are.
                self._error(
                    now_ns, p, code if code >= FIRST_ERROR else EmcyCode.GENERIC * (frame.data[2] > 0), data
                )
            elif base == cia.SDO_CLIENT_BASE and (what := foreign_write(frame.data)):
                self._fall(now_ns, p, f"another client writes {what}", RETRY_NS)
        self._serve(now_ns)
        self._do_what_is_due(now_ns)
        if answers or now_ns >= self._sessions.wake_ns:
            self._converse(now_ns, answers, has_sent_emcy)
        if self._ready and now_ns >= self._hold_until and not self._sessions.n_answering:
            ready, self._ready = self._ready, []
            for p in ready:
                self._start_patch(now_ns, p)
        if now_ns >= self._next_watch:
            self._next_watch = now_ns + self._watch_period
            self._watch(now_ns)
        return self._taken()

    def _do_what_is_due(self, now_ns: int) -> None:
        """Begin boots anew and reset patches that are mute, where it is time."""
        if now_ns >= self._retry_at.min():
            for p in np.flatnonzero(self._retry_at <= now_ns).tolist():
                self._begin(now_ns, p)
        if now_ns >= self._reset_at.min():
            for p in np.flatnonzero(self._reset_at <= now_ns).tolist():  # a boot-up message begins the rest
                self._reset_at[p] = now_ns + MUTE_NS
                self._command(p, NmtCommand.RESET_NODE)

    def _converse(self, now_ns: int, answers: Mapping[int, Sequence[Frame]], has_sent_emcy: set[int]) -> None:
        """Take SDO answers by patch, and act on what has ended."""
        for p in answers:
            if p in self._sessions and self.table.state[p] == PatchState.ABSENT:
                self.table.enter(p, PatchState.BOOTING)
        requests, ended = self._sessions.step(now_ns, answers)
        self._out += requests
        for p, result in ended:
            if isinstance(result, Provisioned):
                self._conclude(now_ns, p, result)
                if result.outcome.is_good and p not in has_sent_emcy:  # that would be newer
                    self._error(now_ns, p, result.error)
            elif len(result.serials) > 1:
                self._refuse(now_ns, p, EventKind.PATCH_DOUBLED, str(result))
            elif len(self._doubts.get(p, ())) >= N_DOUBTS:
                why = "readings came twice in a cycle: two boards?"
                self._refuse(now_ns, p, EventKind.PATCH_DOUBLED, why)
            elif any(result.serials):
                self._named(now_ns, p, result.serials[0])

    def readings(
        self, now_ns: int, owing: Mask, fresh: Mask, bad_length: npt.NDArray[np.int32]
    ) -> list[Event]:
        """Note which of the patches that owed readings have sent them; too many gaps in a row is silence.

        ``bad_length`` (n_patches,) counts PDOs of wrong length since the start.
        """
        silent, back = self.table.note_readings(owing, fresh, ~self._late(now_ns))
        self._retry_at[back] = self._reset_at[back] = NEVER
        self._reset_at[silent] = now_ns + MUTE_NS
        self._is_lost[silent], self._is_lost[back] = True, False
        self._report(now_ns, EventKind.READINGS_LOST, *silent)
        self._report(now_ns, EventKind.PATCH_BACK, *back)
        worse = bad_length != self._bad_length
        if worse.any() or self._has_bad_length.any():
            good = self._has_bad_length & fresh & (not worse.any())
            self._bad_length[:] = bad_length
            self._has_bad_length = self._has_bad_length & ~good | worse
            self._report(now_ns, EventKind.PDO_LENGTH, *np.flatnonzero(worse).tolist())
            self._report(now_ns, EventKind.PDO_LENGTH_END, *np.flatnonzero(good).tolist())
        return self._taken()[1]

    def doubled(self, now_ns: int, patches: Mask) -> tuple[list[Frame], list[Event]]:
        """Take patches (n_patches,) whose readings came twice; they are asked which boards they are."""
        for p in np.flatnonzero(patches & self.table.is_running).tolist():
            if p not in self._sessions:
                recent = [t for t in self._doubts.get(p, ()) if now_ns - t < DOUBTS_NS]
                self._doubts[p] = [*recent, now_ns]
                self._ask(now_ns, p, ask_boards(self._plans[p].node_id))
        return self._taken()

    def _heartbeat_of(self, now_ns: int, p: int, state: int) -> None:
        """Take a heartbeat or boot-up message of patch p."""
        table = self.table
        is_settled = now_ns - self._started_at[p] >= GRACE_NS
        table.heartbeat(now_ns, p, state)
        if state == NmtState.INITIALISING:
            if table.is_running[p]:
                self._fell(now_ns, p, EventKind.PATCH_REBOOTED)
            if now_ns >= self._not_before[p]:
                self._begin(now_ns, p, has_sent_boot_up=True)
        elif state == NmtState.OPERATIONAL:
            if table.state[p] == PatchState.ABSENT and p not in self._sessions:
                self._begin(now_ns, p)
        elif not is_settled:
            pass  # sent before the command arrived
        elif state == NmtState.STOPPED and p not in self._sessions:
            # It answers no SDO in this state; somebody has to get it out of there.
            if table.is_running[p]:
                self._fell(now_ns, p, EventKind.PATCH_FELL_BACK, "it was stopped")
            elif now_ns >= self._not_before[p]:
                self._put_off(now_ns, p)
            else:
                return
            self._retry_at[p] = max(now_ns + RETRY_NS, int(self._not_before[p]))
            self._command(p, NmtCommand.RESET_COMMUNICATION)
        else:  # it fell back without a boot-up: somebody stopped it, or its bus went away
            self._fall(now_ns, p, f"heartbeat with state 0x{state:02X}")

    def _fall(self, now_ns: int, p: int, detail: str, pause_ns: int = 0) -> None:
        """Boot patch p again, if it runs; after a pause where requests of another client might collide."""
        if not self.table.is_running[p]:
            return
        self._fell(now_ns, p, EventKind.PATCH_FELL_BACK, detail)
        if pause_ns:
            self._retry_at[p] = now_ns + pause_ns
        elif now_ns >= self._not_before[p]:
            self._begin(now_ns, p)

    def _fell(self, now_ns: int, p: int, kind: EventKind, detail: str = "") -> None:
        """Note that patch p no longer runs; if it does so time and again it is booted later, not at once."""
        self.table.restarts[p] += 1
        if now_ns - self._started_at[p] >= STABLE_NS:
            self._n_unstable[p] = 0
        if delay_s := self._put_off(now_ns, p):
            delay = f"restart {self.table.restarts[p]}, in {delay_s} s"
            detail = f"{detail}; {delay}" if detail else delay
        self._report(now_ns, kind, p, detail=detail)
        self.table.enter(p, PatchState.BOOTING)
        self._drop(p)
        self._reset_at[p] = NEVER
        self._retry_at[p] = self._not_before[p] if delay_s else NEVER

    def _put_off(self, now_ns: int, p: int) -> int:
        """Put off the next start of patch p, by more each time; return by how many seconds."""
        self._n_unstable[p] += 1
        delay_s = _delay_s(int(self._n_unstable[p]))
        self._not_before[p] = now_ns + 1_000_000_000 * delay_s
        return delay_s

    def _begin(self, now_ns: int, p: int, *, has_sent_boot_up: bool = False) -> None:
        """Start (or start again) the boot of patch p."""
        if self.table.is_running[p]:
            self.table.enter(p, PatchState.BOOTING)
        self._retry_at[p] = self._reset_at[p] = NEVER
        is_first = has_sent_boot_up and not self._has_booted[p]
        if is_first:
            self._has_booted[p] = True
            self._hold_until = now_ns + HOLD_NS
        self._drop(p)
        script = provision(self._plans[p], Task.BOOT, is_restored=bool(self._is_restored[p]))
        self._ask(now_ns, p, script, is_there=is_first)

    def _ask(self, now_ns: int, p: int, script: Script[Ended], *, is_there: bool = False) -> None:
        node_id = self._plans[p].node_id
        self._out += self._sessions.begin(now_ns, p, node_id, script, is_there=is_there)

    def _drop(self, p: int) -> None:
        """Drop the boot of patch p."""
        self._sessions.drop(p)
        if p in self._ready:
            self._ready.remove(p)

    def _conclude(self, now_ns: int, p: int, result: Provisioned) -> None:
        """Act on the end of a boot."""
        before, outcome = self.table.state[p], result.outcome
        if outcome.is_good:
            self._is_restored[p] = False
            self._ready.append(p)
            if result.n_written:
                self._report(now_ns, EventKind.PATCH_CONFIGURED, p, detail=f"{result.n_written} objects")
            return
        self._retry_at[p] = now_ns + RETRY_NS
        if outcome is Provision.RESTORED:
            self._is_restored[p] = True
            self._command(p, NmtCommand.RESET_NODE)
        elif outcome in REFUSALS:
            self._refuse(now_ns, p, REFUSALS[outcome], result.reason)
        else:
            self.table.enter(p, PatchState.ABSENT)
            if before != PatchState.ABSENT or not self._is_lost[p]:
                self._report(now_ns, EventKind.PATCH_LOST, p, detail=result.reason)
            self._is_lost[p] = True

    def _refuse(self, now_ns: int, p: int, kind: EventKind, reason: str) -> None:
        """Do not let patch p run, and look at it again later."""
        self._n_doubled[p] += kind is EventKind.PATCH_DOUBLED
        self._retry_at[p] = now_ns + max(RETRY_NS, 1_000_000_000 * _delay_s(int(self._n_doubled[p]) + 1))
        if self.table.nmt[p] == NmtState.OPERATIONAL:
            self._command(p, NmtCommand.PRE_OPERATIONAL)
        if self.table.state[p] != PatchState.WRONG:
            self.table.enter(p, PatchState.WRONG)
            self._report(now_ns, kind, p, detail=reason)

    def _start_patch(self, now_ns: int, p: int) -> None:
        self.table.enter(p, PatchState.OPERATIONAL)
        self.table.missed[p] = 0
        self.table.nmt[p] = NmtState.OPERATIONAL
        self.table.last_heard[p] = self._started_at[p] = now_ns
        self._doubts.pop(p, None)
        self._n_doubled[p], self._is_unnamed[p] = 0, True
        self._command(p, NmtCommand.START)
        self._report(now_ns, EventKind.PATCH_STARTED, p)
        if self._is_lost[p]:
            self._is_lost[p] = False
            self._report(now_ns, EventKind.PATCH_BACK, p)

    def _serve(self, now_ns: int) -> None:
        """Reset what clients have asked for; the boot-up messages begin the rest."""
        requests, self._requests = self._requests, []
        for target, command in requests:
            for p in range(len(self._plans)) if target is None else (target,):
                if self.table.is_running[p]:
                    self.table.enter(p, PatchState.BOOTING)
                self._n_unstable[p] = self._not_before[p] = 0
                self._retry_at[p], self._reset_at[p] = now_ns + RETRY_NS, NEVER
                self._drop(p)
            self._out.append(nmt_frame(command, 0 if target is None else self._plans[target].node_id))

    def _watch(self, now_ns: int) -> None:
        """Look for heartbeats that have stopped."""
        lost = self.table.is_running & self._late(now_ns) & (self._retry_at == NEVER)
        self._retry_at[lost] = now_ns + RETRY_NS  # it may have been unplugged: probe it
        self._reset_at[lost], self._is_lost[lost] = NEVER, True
        for p in np.flatnonzero(lost).tolist():
            self.table.enter(p, PatchState.SILENT)
            self._report(now_ns, EventKind.HEARTBEAT_LOST, p)
        unnamed = self._is_unnamed & self.table.is_running & (now_ns - self._started_at >= NAMED_NS)
        if unnamed.any() and not self._sessions:  # one at a time, when nothing else is asked
            p = int(unnamed.argmax())
            self._is_unnamed[p] = False
            self._ask(now_ns, p, ask_boards(self._plans[p].node_id))

    def _named(self, now_ns: int, p: int, serial: int) -> None:
        """Take the serial number of patch p; another board may have its place since it ran last."""
        before = int(self.table.serial[p])
        if before and before != serial:
            detail = f"serial number {serial} in place of {before}"
            self._report(now_ns, EventKind.PATCH_REPLACED, p, detail=detail)
        self.table.serial[p] = serial

    def _late(self, now_ns: int) -> Mask:
        """Return which patches owe a heartbeat for too long, (n_patches,)."""
        return (self._lost_after > 0) & (now_ns - self.table.last_heard > self._lost_after)

    def _command(self, p: int, command: NmtCommand) -> None:
        self._out.append(nmt_frame(command, self._plans[p].node_id))

    def _error(self, now_ns: int, p: int, code: int, data: bytes = b"") -> None:
        """Take the newest error of patch p, GENERIC for one that is not known, 0 for none."""
        before = self.table.error[p]
        if code == before or (before and code == EmcyCode.GENERIC):
            return
        self.table.error[p] = code
        kind = EventKind.PATCH_EMCY if code else EventKind.PATCH_EMCY_CLEARED
        self._report(now_ns, kind, p, detail=cia.describe_emcy(code, data) if code else "")

    def _report(self, now_ns: int, kind: EventKind, *patches: int, detail: str = "") -> None:
        self._events += [
            Event(t_ns=now_ns, kind=kind, node_id=self._plans[p].node_id, detail=detail) for p in patches
        ]

    def _taken(self) -> tuple[list[Frame], list[Event]]:
        """Return what is to be sent, and events, since the last call."""
        out, events, self._out, self._events = self._out, self._events, [], []
        return out, events


AFTER = {
    NmtCommand.START: PatchState.OPERATIONAL,
    NmtCommand.STOP: PatchState.BOOTING,
    NmtCommand.PRE_OPERATIONAL: PatchState.BOOTING,
    NmtCommand.RESET_NODE: PatchState.BOOTING,
    NmtCommand.RESET_COMMUNICATION: PatchState.BOOTING,
}
"""What a patch is after an NMT command: one that is not operational has to be booted again."""


def _delay_s(n: int) -> int:
    """Return the delay (s) after the n-th failure in a row."""
    return DELAYS_S[min(n, len(DELAYS_S)) - 1]


class PassiveMonitor:
    """The states of patches from the frames on their bus alone; nothing is sent.

    A patch is operational until the bus shows otherwise: reception may have begun in the middle. One that
    boots, by its boot-up message or an NMT command, owes no readings until it is started, reports it in its
    heartbeat, or sends readings.
    """

    wake_ns: int = NEVER

    def __init__(self, node_ids: Sequence[int], table: PatchTable) -> None:
        self._node_ids = tuple(node_ids)
        self._table = table
        self._heartbeat = {cia.HEARTBEAT_BASE + node_id: p for p, node_id in enumerate(node_ids)}
        self.cob_ids = frozenset(self._heartbeat) | {cia.NMT_COMMAND_ID}
        table.state[:] = PatchState.OPERATIONAL

    def start(self, now_ns: int, *, is_first: bool) -> list[Frame]:
        """Begin: nothing is sent."""
        return []

    def step(self, now_ns: int, frames: Sequence[Frame]) -> tuple[list[Frame], list[Event]]:
        """Take NMT commands, boot-up messages and heartbeats."""
        for frame in frames:
            if frame.can_id == cia.NMT_COMMAND_ID:
                for p, node_id in enumerate(self._node_ids):
                    if (command := command_for(frame.data, node_id)) is not None:
                        self._enter(p, AFTER[command])
            elif (sender := self._heartbeat.get(frame.can_id)) is not None and len(frame.data) == 1:
                self._heartbeat_of(now_ns, sender, frame.data[0] & 0x7F)
        return [], []

    def readings(
        self,
        now_ns: int,
        owing: Mask,
        fresh: Mask,
        bad_length: npt.NDArray[np.int32],
    ) -> list[Event]:
        """Note which patches have sent readings: one that does is operational (CiA 301, 7.3.2.2.4)."""
        table = self._table
        for p in np.flatnonzero(fresh & ~table.is_running).tolist():
            table.enter(p, PatchState.OPERATIONAL)
        silent, back = table.note_readings(owing, fresh, np.ones_like(fresh))
        kinds = [(p, EventKind.READINGS_LOST) for p in silent] + [(p, EventKind.PATCH_BACK) for p in back]
        return [Event(t_ns=now_ns, kind=kind, node_id=self._node_ids[p]) for p, kind in kinds]

    def doubled(self, now_ns: int, patches: Mask) -> tuple[list[Frame], list[Event]]:
        """Report them: which boards they are is not asked."""
        found = np.flatnonzero(patches).tolist()
        return [], [
            Event(t_ns=now_ns, kind=EventKind.PATCH_DOUBLED, node_id=self._node_ids[p]) for p in found
        ]

    def request(self, p: int | None, command: NmtCommand) -> AbortCode | None:
        """Refuse: another master commands them."""
        return AbortCode.LOCAL_CONTROL

    def bus_is_lost(self) -> None:
        """A recording does not report it; the patches fall silent."""

    def bus_is_back(self, now_ns: int) -> None:
        """They send again."""

    def _heartbeat_of(self, now_ns: int, p: int, state: int) -> None:
        self._table.heartbeat(now_ns, p, state)
        if state == NmtState.INITIALISING:
            self._enter(p, PatchState.BOOTING)
        elif state == NmtState.OPERATIONAL and not self._table.is_running[p]:
            self._enter(p, PatchState.OPERATIONAL)

    def _enter(self, p: int, state: PatchState) -> None:
        self._table.enter(p, state)
        self._table.missed[p] = 0


PatchMonitor = Supervisor | PassiveMonitor
"""The monitor of the patches on a bus, active or passive."""
