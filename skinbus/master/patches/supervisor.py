"""Supervision: boots the patches side by side, watches their heartbeats, and recovers those that return.

docs/canopen.md says what leads from one state of a patch to another. Where another master boots the patches,
a ``PatchMonitor`` takes the place of the supervisor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from skinbus.can.core import NEVER, Output
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame, Frames
from skinbus.master.commissioning.sessions import Script, Sessions, Timeouts
from skinbus.master.guarding import Guarding
from skinbus.master.patches.provisioning import (
    Answering,
    ExpectedNode,
    Provision,
    Provisioned,
    Task,
    ask_boards,
    by_itself,
    foreign_write,
    provision,
)
from skinbus.master.patches.table import Mask, PatchState, PatchTable
from skinbus.node.nmt import command_for, nmt_frame
from skinbus.objects import cia
from skinbus.objects.cia import AbortCode, EmcyCode, NmtCommand, NmtState

LONGEST_S = 30
"""Longest pause before the start of a patch that stops running soon after each, or between looks at a double
node-ID. The first one is none, the second a second; each is twice as long as the one before."""

STEADY_NS = 5_000_000_000
"""A patch that has run for so long, and as long as its last pause, is started again at once."""

HOLD_NS = 20_000_000
"""No patch is started so soon after the first boot-up message of another: on the wire these give way to SDO,
so those of many boards that start together come one by one; 20 frame times at 125 kbit/s."""

RETRY_NS = 1_000_000_000
"""Pause between attempts to reach a patch that does not answer: long against a boot. A heartbeat that
contradicts the start of a patch so soon after was under way before, on a full bus or a busy machine."""

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

Ended = Provisioned | Answering | None
"""What a session returned: of a boot, of a question for the boards of a node-ID, or of guard limits."""


class PatchMonitor:
    """The states of patches from the frames on their bus alone; nothing is sent.

    A patch is operational until the bus shows otherwise: reception may have begun in the middle. One that
    boots, by its boot-up message or an NMT command, owes no readings until it is started, reports it in its
    heartbeat, or sends readings.
    """

    SERVICES: tuple[int, ...] = (cia.HEARTBEAT_BASE,)
    BEGINS = PatchState.OPERATIONAL

    def __init__(self, plans: Sequence[ExpectedNode], table: PatchTable) -> None:
        self.table = table
        self._plans = tuple(plans)
        self._out: list[Frame] = []
        self._events: list[Event] = []
        self._sender = {
            base + plan.node_id: (base, p) for base in self.SERVICES for p, plan in enumerate(plans)
        }
        """By identifier: which service of which patch."""
        self.cob_ids = frozenset(self._sender) | {cia.NMT_COMMAND_ID}
        table.state[:] = self.BEGINS

    @property
    def wake_ns(self) -> int:
        """Time of the next thing to do (ns)."""
        return NEVER

    def start(self, now_ns: int, *, is_first: bool) -> list[Frame]:
        """Begin; return what is sent."""
        return []

    def step(self, now_ns: int, frames: Frames) -> Output:
        """Take control-plane frames; return frames to send, and events."""
        for frame in frames:
            _, sender = self._sender.get(frame.can_id, (0, None))
            if frame.can_id == cia.NMT_COMMAND_ID:
                for p, plan in enumerate(self._plans):
                    if (command := command_for(frame.data, plan.node_id)) is not None:
                        # one that is not operational has to be booted again
                        self._enter(
                            p, PatchState.OPERATIONAL if command is NmtCommand.START else PatchState.BOOTING
                        )
            elif sender is not None and len(frame.data) == 1:
                state = frame.data[0] & 0x7F
                self.table.heartbeat(now_ns, sender, state)
                if state == NmtState.INITIALISING:
                    self._enter(sender, PatchState.BOOTING)
                elif state == NmtState.OPERATIONAL and not self.table.is_running[sender]:
                    self._enter(sender, PatchState.OPERATIONAL)
        return [], []

    def _enter(self, p: int, state: PatchState) -> None:
        self.table.enter(p, state)
        self.table.missed[p] = 0

    def readings(self, now_ns: int, owing: Mask, fresh: Mask) -> list[Event]:
        """Note which of the patches that owed readings have sent them; too many gaps in a row is silence.

        One that sends some is operational (CiA 301, 7.3.2.2.4).
        """
        for p in np.flatnonzero(fresh & ~self.table.is_running).tolist():
            self.table.enter(p, PatchState.OPERATIONAL)
        self._note_readings(now_ns, owing, fresh, np.ones_like(fresh))
        return self._taken()[1]

    def _note_readings(self, now_ns: int, owing: Mask, fresh: Mask, can_return: Mask) -> tuple[Mask, Mask]:
        silent, back = self.table.note_readings(owing, fresh, can_return)
        self._report(now_ns, EventKind.READINGS_LOST, silent)
        self._report(now_ns, EventKind.PATCH_BACK, back)
        return silent, back

    def stop(self, now_ns: int, until_ns: int, doubled: Mask, late: Mask) -> Output:
        """Take patches (n_patches,) whose readings came twice, and those whose are missing or late."""
        self._report(now_ns, EventKind.PATCH_DOUBLED, doubled)
        return self._taken()

    def request(self, p: int | None, command: NmtCommand) -> AbortCode | None:
        """Reset patch p, or all, with the next step, because a client asks for it; return why not."""
        return AbortCode.LOCAL_CONTROL

    def bus_is_lost(self) -> None:
        """Nothing is received until the bus is back."""

    def bus_is_back(self, now_ns: int) -> None:
        """They send again."""

    def _report(self, now_ns: int, kind: EventKind, patches: int | Mask, detail: str = "") -> None:
        """Report an event of one patch, or of all in a mask."""
        for p in np.flatnonzero(patches) if isinstance(patches, np.ndarray) else (patches,):
            node_id = self._plans[p].node_id
            self._events.append(Event(now_ns, kind, node_id=node_id, detail=detail))

    def _taken(self) -> Output:
        """Return what is to be sent, and events, since the last call."""
        out, events, self._out, self._events = self._out, self._events, [], []
        return out, events


class Supervisor(PatchMonitor):
    """Owns the state of every patch; frames and time in, frames and events out.

    Readings of started patches would slow the boots of the others down: all that are there are started
    together. A patch is waited for once: one that reboots again and again delays no other.
    """

    SERVICES = (cia.SDO_SERVER_BASE, cia.HEARTBEAT_BASE, cia.EMCY_BASE, cia.SDO_CLIENT_BASE)
    BEGINS = PatchState.ABSENT

    def __init__(
        self,
        plans: Sequence[ExpectedNode],
        table: PatchTable,
        timeouts: Timeouts | None = None,
        guarding: Guarding | None = None,
    ) -> None:
        super().__init__(plans, table)
        self._guarding = guarding
        self._others = guarding.indices if guarding else frozenset[int]()
        n = len(plans)
        self._sessions: Sessions[Ended] = Sessions(timeouts)
        self._ready: list[int] = []  # booted, and not started yet
        self._hold_until = 0
        self._has_booted, self._is_restored, self._is_unnamed = np.zeros((3, n), np.bool_)
        self._is_lost = np.zeros(n, np.bool_)  # as the log has it: "back" follows
        self._due = np.full((2, n), NEVER)
        self._try_at, self._reset_at = self._due
        self._started_at, self._not_before, self._pause_s = np.zeros((3, n), np.int64)
        self._requests: list[tuple[int | None, NmtCommand]] = []
        self._is_bus_lost = False
        lost_after = [int(HEARTBEAT_FACTOR * plan.heartbeat_ns) or NEVER for plan in plans]
        self._lost_after = np.array(lost_after, np.int64)
        # Four times per time-out: a loss is detected at most a quarter of it late.
        self._watch_period = min(lost_after, default=NEVER) // 4
        self._next_watch = NEVER

    def start(self, now_ns: int, *, is_first: bool) -> list[Frame]:
        """Begin: every node goes through its boot-up, whatever it was doing before.

        Only the first time by a broadcast: two masters would answer each other's for ever.
        """
        self.table.state[self.table.is_running] = PatchState.ABSENT
        self.table.error[:] = 0  # each patch is asked for its errors at its boot
        self._sessions.clear()
        self._ready.clear()
        self._has_booted[:] = self._is_lost[:] = False
        self._pause_s[:] = self._not_before[:] = 0
        self._try_at[:], self._reset_at[:] = now_ns + RETRY_NS, NEVER
        self._next_watch = now_ns + self._watch_period
        is_asked = any(target is None for target, _ in self._requests)  # a client has all of them reset
        node_ids = [0] if is_first else [plan.node_id for plan in self._plans if not is_asked]
        return [nmt_frame(NmtCommand.RESET_COMMUNICATION, node_id) for node_id in node_ids]

    def bus_is_lost(self) -> None:
        """Suspend supervision until the bus is back: silence proves nothing about a patch now."""
        self._is_bus_lost = True

    def bus_is_back(self, now_ns: int) -> None:
        """Resume: no patch is late for what was lost, and what was asked then is asked again."""
        self._is_bus_lost, self.table.last_heard[:] = False, now_ns
        self._try_at[:] = np.where(self.table.is_running, NEVER, now_ns)
        self._reset_at[self.table.state == PatchState.SILENT] = now_ns + MUTE_NS  # readings suffice

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
        return min(int(self._due.min()), self._next_watch, self._sessions.wake_ns, hold)

    def step(self, now_ns: int, frames: Frames) -> Output:
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
                code = int.from_bytes(frame.data[:2], "little")
                # Which error is over it does not say (CiA 301, 7.2.7.1): the last code stays until all are.
                code = code if code >= FIRST_ERROR else EmcyCode.GENERIC * (frame.data[2] > 0)
                self._error(now_ns, p, code, frame.data[3:])
            elif base == cia.SDO_CLIENT_BASE and (what := foreign_write(frame.data, self._others)):
                # one that is not started may run even so, and guard by limits that nobody knows
                self._command(p, NmtCommand.PRE_OPERATIONAL)
                if self._try_at[p] == NEVER:  # it runs, or its boot has read what is no longer so
                    # not at once: the requests of the other client might collide
                    self._fell(
                        now_ns, p, EventKind.PATCH_FELL_BACK, f"another client writes {what}", RETRY_NS
                    )
        self._serve(now_ns)
        if now_ns >= self._due.min():
            for p in np.flatnonzero(self._try_at <= now_ns).tolist():
                self._begin(now_ns, p)
            for p in np.flatnonzero(self._reset_at <= now_ns).tolist():  # a boot-up message begins the rest
                self._reset_at[p] = now_ns + MUTE_NS
                self._command(p, NmtCommand.RESET_NODE)
        if answers or now_ns >= self._sessions.wake_ns:
            self._converse(now_ns, answers, has_sent_emcy)
        if self._ready and now_ns >= self._hold_until and not self._sessions.n_answering:
            ready, self._ready = self._ready, []
            for p in ready:
                self._start_patch(now_ns, p)
        if self._guarding and self._guarding.due and not self._sessions and not self._ready:
            due = self._guarding.due.pop()
            if self.table.is_running[due]:
                self._ask(now_ns, due, by_itself(self._guarding.write(due)))
        if now_ns >= self._next_watch:
            self._next_watch = now_ns + self._watch_period
            self._watch(now_ns)
        return self._taken()

    def _converse(self, now_ns: int, answers: Mapping[int, Frames], has_sent_emcy: set[int]) -> None:
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
            elif result is None:
                pass
            elif len(result.serials) > 1:
                self._refuse(now_ns, p, EventKind.PATCH_DOUBLED, str(result))
            elif any(result.serials):
                before, (serial,) = int(self.table.serial[p]), result.serials
                if before not in (0, serial):  # another board has its place since it ran last
                    detail = f"serial number {serial} in place of {before}"
                    self._report(now_ns, EventKind.PATCH_REPLACED, p, detail)
                self.table.serial[p] = serial

    def readings(self, now_ns: int, owing: Mask, fresh: Mask) -> list[Event]:
        """As of any monitor; a patch that is mute is reset after a while, one that is back need not be."""
        silent, back = self._note_readings(now_ns, owing, fresh, ~self._late(now_ns))
        self._due[:, back] = NEVER
        self._reset_at[silent] = now_ns + MUTE_NS
        self._is_lost[silent], self._is_lost[back] = True, False
        return self._taken()[1]

    def stop(self, now_ns: int, until_ns: int, doubled: Mask, late: Mask) -> Output:
        """Stop these patches until then and boot them: of two boards under one node-ID both answer."""
        for p in np.flatnonzero((doubled | late) & self.table.is_running).tolist():
            if doubled[p]:
                self._fall(now_ns, p, "readings came twice in a cycle", until_ns - now_ns)
            else:
                self._stop(p)
                self._command(p, NmtCommand.PRE_OPERATIONAL)
                self._try_at[p] = until_ns
        return self._taken()

    def _heartbeat_of(self, now_ns: int, p: int, state: int) -> None:
        """Take a heartbeat or boot-up message of patch p."""
        table, may_begin = self.table, now_ns >= self._not_before[p]
        table.heartbeat(now_ns, p, state)
        if state == NmtState.INITIALISING and table.is_running[p]:
            self._fell(now_ns, p, EventKind.PATCH_REBOOTED)
        elif state == NmtState.INITIALISING and may_begin:
            self._begin(now_ns, p, has_sent_boot_up=True)
        elif state == NmtState.OPERATIONAL:
            if table.state[p] == PatchState.ABSENT and p not in self._sessions:
                self._begin(now_ns, p)
        elif now_ns - self._started_at[p] < RETRY_NS:
            pass  # sent before the command arrived
        elif state != NmtState.STOPPED or p in self._sessions:
            # it fell back without a boot-up: somebody stopped it, or its bus went away
            self._fall(now_ns, p, f"heartbeat with state 0x{state:02X}")
        elif table.is_running[p] or may_begin:
            # It answers no SDO in this state; somebody has to get it out of there.
            self._fell(now_ns, p, EventKind.PATCH_FELL_BACK, "it was stopped", RETRY_NS)
            self._command(p, NmtCommand.RESET_COMMUNICATION)

    def _fall(self, now_ns: int, p: int, detail: str, least_ns: int = 0) -> None:
        """Stop patch p, if it runs, and boot it again."""
        if self.table.is_running[p]:
            self._silence(p)
            self._fell(now_ns, p, EventKind.PATCH_FELL_BACK, detail, least_ns)

    def _fell(self, now_ns: int, p: int, kind: EventKind, detail: str = "", least_ns: int = 0) -> None:
        """Boot patch p again: at once, after ``least_ns``, or later if it falls time and again."""
        ran_ns = (now_ns - self._started_at[p]) * self.table.is_running[p]
        if ran_ns >= max(STEADY_NS, 1_000_000_000 * self._pause_s[p]):
            self._pause_s[p] = 0
        self.table.restarts[p] += 1
        self._stop(p)
        if pause_s := self._back_off(now_ns, p):
            pause = f"restart {self.table.restarts[p]}, in {pause_s} s"
            detail = f"{detail}; {pause}" if detail else pause
        self._try_at[p] = max(now_ns + least_ns, int(self._not_before[p]))
        self._report(now_ns, kind, p, detail)

    def _back_off(self, now_ns: int, p: int) -> int:
        """Put off the next start of patch p, by more with each failure; return by how many seconds."""
        pause_s = int(self._pause_s[p])
        self._not_before[p] = now_ns + 1_000_000_000 * pause_s
        self._pause_s[p] = min(max(1, 2 * pause_s), LONGEST_S)
        return pause_s

    def _stop(self, p: int) -> None:
        """Abandon what goes on with patch p: it has to be booted."""
        if self.table.is_running[p]:
            self.table.enter(p, PatchState.BOOTING)
        self._due[:, p] = NEVER
        self._sessions.pop(p, None)
        if p in self._ready:
            self._ready.remove(p)

    def _begin(self, now_ns: int, p: int, *, has_sent_boot_up: bool = False) -> None:
        """Start (or start again) the boot of patch p."""
        self._stop(p)
        if has_sent_boot_up and not self._has_booted[p]:
            self._has_booted[p] = True
            self._hold_until = now_ns + HOLD_NS
        guard = self._guarding.write(p) if self._guarding else None
        is_restored = bool(self._is_restored[p])
        self._ask(now_ns, p, provision(self._plans[p], Task.BOOT, is_restored=is_restored, guard=guard))

    def _ask(self, now_ns: int, p: int, script: Script[Ended]) -> None:
        self._out += self._sessions.begin(now_ns, p, self._plans[p].node_id, script)

    def _conclude(self, now_ns: int, p: int, result: Provisioned) -> None:
        """Act on the end of a boot."""
        outcome = result.outcome
        if outcome.is_good:
            self._is_restored[p] = False
            self._ready.append(p)
            if result.n_written:
                self._report(now_ns, EventKind.PATCH_CONFIGURED, p, f"{result.n_written} objects")
        elif outcome in REFUSALS:
            self._refuse(now_ns, p, REFUSALS[outcome], result.reason)
        else:
            self._try_at[p] = now_ns + RETRY_NS
            if outcome is Provision.RESTORED:
                self._is_restored[p] = True
                self._command(p, NmtCommand.RESET_NODE)
                return
            if self.table.state[p] != PatchState.ABSENT or not self._is_lost[p]:
                self._report(now_ns, EventKind.PATCH_LOST, p, result.reason)
            self.table.enter(p, PatchState.ABSENT)
            self._is_lost[p] = True

    def _refuse(self, now_ns: int, p: int, kind: EventKind, reason: str) -> None:
        """Do not let patch p run, and look at it again later, at a double node-ID more and more rarely."""
        pause_s = self._back_off(now_ns, p) if kind is EventKind.PATCH_DOUBLED else 0
        self._try_at[p] = now_ns + max(RETRY_NS, 1_000_000_000 * pause_s)
        self._silence(p)
        if self.table.state[p] != PatchState.WRONG:
            self.table.enter(p, PatchState.WRONG)
            self._report(now_ns, kind, p, reason)

    def _start_patch(self, now_ns: int, p: int) -> None:
        self._silence(p)  # with the start it sends what has not changed, too
        self._enter(p, PatchState.OPERATIONAL)
        self.table.nmt[p] = NmtState.OPERATIONAL
        self.table.last_heard[p] = self._started_at[p] = now_ns
        self._is_unnamed[p] = True
        self._command(p, NmtCommand.START)
        self._report(now_ns, EventKind.PATCH_STARTED, p)
        if self._is_lost[p]:
            self._is_lost[p] = False
            self._report(now_ns, EventKind.PATCH_BACK, p)

    def _silence(self, p: int) -> None:
        """Let patch p send no readings, if it may do so."""
        if self.table.nmt[p] == NmtState.OPERATIONAL:
            self._command(p, NmtCommand.PRE_OPERATIONAL)

    def _serve(self, now_ns: int) -> None:
        """Reset what clients have asked for; the boot-up messages begin the rest."""
        requests, self._requests = self._requests, []
        for target, command in requests:
            for p in range(len(self._plans)) if target is None else (target,):
                self._stop(p)
                self._pause_s[p] = self._not_before[p] = 0
                self._try_at[p] = now_ns + RETRY_NS
            self._out.append(nmt_frame(command, 0 if target is None else self._plans[target].node_id))

    def _watch(self, now_ns: int) -> None:
        """Look for heartbeats that have stopped."""
        lost = self.table.is_running & self._late(now_ns) & (self._try_at == NEVER)
        self._try_at[lost] = now_ns + RETRY_NS  # it may have been unplugged: probe it
        self._reset_at[lost], self._is_lost[lost] = NEVER, True
        self.table.state[lost] = PatchState.SILENT
        self._report(now_ns, EventKind.HEARTBEAT_LOST, lost)
        unnamed = self._is_unnamed & self.table.is_running & (now_ns - self._started_at >= NAMED_NS)
        if unnamed.any() and not self._sessions:  # one at a time, when nothing else is asked
            p = int(unnamed.argmax())
            self._is_unnamed[p] = False
            self._ask(now_ns, p, ask_boards(self._plans[p].node_id))

    def _late(self, now_ns: int) -> Mask:
        """Return which patches owe a heartbeat for too long, (n_patches,)."""
        return np.asarray(now_ns - self.table.last_heard > self._lost_after)

    def _command(self, p: int, command: NmtCommand) -> None:
        self._out.append(nmt_frame(command, self._plans[p].node_id))

    def _error(self, now_ns: int, p: int, code: int, data: bytes = b"") -> None:
        """Take the newest error of patch p, GENERIC for one that is not known, 0 for none."""
        before = self.table.error[p]
        if code == before or (before and code == EmcyCode.GENERIC):
            return
        self.table.error[p] = code
        kind = EventKind.PATCH_EMCY if code else EventKind.PATCH_EMCY_CLEARED
        self._report(now_ns, kind, p, cia.describe_emcy(code, data) if code else "")
