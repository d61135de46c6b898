"""Supervision: boots the patches side by side, watches their heartbeats, and recovers those that return.

The states of a patch and what leads from one to another are in ``table.TRANSITIONS``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from skinbus.can.core import NEVER
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.master.commissioning.sessions import Sessions, Timeouts
from skinbus.master.patches.expected_nodes import ExpectedNode
from skinbus.master.patches.patch_errors import EMCY_LENGTH, Noticed, take_emcy, take_error
from skinbus.master.patches.provisioning import BOOT, Provision, Provisioned, ask_error, provision
from skinbus.master.patches.table import PatchState, PatchTable
from skinbus.node.nmt import nmt_frame
from skinbus.node.sdo_client import DEFAULT_TIMEOUT_NS
from skinbus.objects import cia

RETRY_NS = 1_000_000_000
"""Pause between attempts to reach a patch that does not answer: long against a boot, short for people."""

HEARTBEAT_FACTOR = 3.0
"""A patch is lost after this many heartbeat periods; the factor of lely's dcfgen (heartbeat_multiplier)."""

START_GRACE_NS = 100_000_000
"""A heartbeat that contradicts a start command so soon after was under way before: two full buses long."""

HOLD_NS = 20_000_000
"""No patch is started so soon after the first boot-up message of another: on the wire these give way to SDO,
so many boards that start together are heard of one by one; 20 frame times at 125 kbit/s."""

MUTE_NS = 5_000_000_000
"""A patch that lives but sends no readings for so long is reset: long against a boot and a passing fault."""

RESETS = (cia.NmtCommand.RESET_NODE, cia.NmtCommand.RESET_COMMUNICATION)

HELD_IN = {
    cia.NmtCommand.STOP: cia.NmtState.STOPPED,
    cia.NmtCommand.PRE_OPERATIONAL: cia.NmtState.PRE_OPERATIONAL,
}
"""The state in which a patch is after the command of a client that holds it."""


class Supervisor:
    """Owns the state of every patch; frames and time in, frames and events out."""

    def __init__(
        self, plans: Sequence[ExpectedNode], table: PatchTable, timeout_ns: int = DEFAULT_TIMEOUT_NS
    ) -> None:
        """``timeout_ns``: how long an answer to an SDO request is awaited."""
        self.table = table
        self._plans = tuple(plans)
        node_ids = [plan.node_id for plan in plans]
        self._lost_after = np.array([round(HEARTBEAT_FACTOR * plan.heartbeat_ns) for plan in plans], np.int64)
        self._retry_at = np.full(len(plans), NEVER, np.int64)
        self._reset_at = np.full(len(plans), NEVER, np.int64)
        self._started_at = np.zeros(len(plans), np.int64)
        self._next_watch = NEVER
        self._sessions: Sessions[Provisioned | int | None] = Sessions(Timeouts(sdo_ns=timeout_ns))
        self._is_bus_lost = False
        self._to_ask = np.zeros(len(plans), np.bool_)  # for errors: an EMCY may have been lost
        self._ready: list[int] = []
        self._held_by: list[cia.NmtCommand | None] = [None] * len(plans)
        self._requests: list[tuple[int | None, cia.NmtCommand]] = []
        self._has_booted = np.zeros(len(plans), np.bool_)
        self._is_restored = np.zeros(len(plans), np.bool_)  # to its defaults, and not accepted since
        self._hold_until = 0
        self._bad_length_seen = np.zeros(len(plans), np.int32)
        self._has_bad_length = np.zeros(len(plans), np.bool_)
        self._sdo = {cia.SDO_SERVER_BASE + node_id: p for p, node_id in enumerate(node_ids)}
        self._heartbeat = {cia.HEARTBEAT_BASE + node_id: p for p, node_id in enumerate(node_ids)}
        self._emcy = {cia.EMCY_BASE + node_id: p for p, node_id in enumerate(node_ids)}
        self.cob_ids = frozenset(self._sdo) | frozenset(self._heartbeat) | frozenset(self._emcy)
        watched = self._lost_after[self._lost_after > 0]
        # Looked at four times per time-out: a loss is noticed at most a quarter of it late.
        self._watch_period = int(watched.min()) // 4 if len(watched) else NEVER

    def start(self, now_ns: int) -> list[Frame]:
        """Begin: every node goes through its boot-up, whatever it was doing before."""
        for p in np.flatnonzero(self.table.is_running | self.table.is_held).tolist():
            self.table.enter(p, PatchState.ABSENT)
        self._ready.clear()
        self._held_by[:] = [None] * len(self._plans)
        self._requests.clear()
        self.table.error[:] = 0  # each patch is asked for its errors at its boot
        self._sessions.clear()
        self._has_booted[:] = False
        self._retry_at[:] = now_ns + RETRY_NS
        self._reset_at[:] = NEVER
        self._next_watch = now_ns + self._watch_period if self._watch_period < NEVER else NEVER
        return [nmt_frame(cia.NmtCommand.RESET_COMMUNICATION, 0)]

    def bus_is_lost(self) -> None:
        """Suspend supervision until the bus is back: silence proves nothing about a patch now."""
        self._is_bus_lost = True

    def bus_is_back(self, now_ns: int) -> None:
        """Resume: no patch is late for what was lost, and what was asked then is asked again."""
        self._is_bus_lost = False
        self.table.last_heard[:] = now_ns
        silent = self.table.state == PatchState.SILENT
        self._retry_at[silent] = NEVER  # readings suffice
        self._reset_at[silent] = now_ns + MUTE_NS
        unheard = np.array([p in self._sessions for p in range(len(self._retry_at))]) & ~self.table.is_running
        self._retry_at[(self._retry_at < NEVER) | unheard] = now_ns
        self._to_ask |= self.table.is_running

    def request(self, p: int | None, command: cia.NmtCommand) -> cia.AbortCode | None:
        """Command patch p, or all, with the next step, because a client asks for it; return why not.

        One that is stopped stays so, through its own reboots too, until a client starts or resets it.
        """
        if p is not None and command is cia.NmtCommand.START and self.table.state[p] == PatchState.WRONG:
            return cia.AbortCode.DEVICE_STATE
        self._requests.append((p, command))
        return None

    @property
    def wake_ns(self) -> int:
        """Time of the next thing to do (ns)."""
        if self._is_bus_lost:
            return NEVER
        if self._requests or self._to_ask.any():
            return 0
        hold = self._hold_until if self._ready and not self._sessions.n_answering else NEVER
        asks = min(int(self._retry_at.min()), int(self._reset_at.min()))
        return min(asks, self._next_watch, self._sessions.wake_ns, hold)

    def step(self, now_ns: int, frames: Sequence[Frame]) -> tuple[list[Frame], list[Event]]:
        """Take control-plane frames; return frames to send and what was noticed."""
        out: list[Frame] = []
        events: list[Event] = []
        answers: dict[int, list[Frame]] = {}
        has_sent_emcy: set[int] = set()
        if self._is_bus_lost:
            return out, events
        for frame in frames:
            if (p := self._sdo.get(frame.can_id)) is not None:
                answers.setdefault(p, []).append(frame)
            elif (p := self._heartbeat.get(frame.can_id)) is not None:
                self._heartbeat_of(now_ns, p, frame, out, events)
            elif (p := self._emcy.get(frame.can_id)) is not None and len(frame.data) == EMCY_LENGTH:
                has_sent_emcy.add(p)
                events += self._noticed(now_ns, p, take_emcy(self.table, p, frame))
        if self._requests:
            self._serve(now_ns, out, events)
        if self._to_ask.any():
            for p in np.flatnonzero(self._to_ask & self.table.is_running).tolist():
                out += self._sessions.begin(now_ns, p, self._plans[p].node_id, ask_error())
            self._to_ask[:] = False
        if now_ns >= self._retry_at.min():
            for p in np.flatnonzero(self._retry_at <= now_ns).tolist():
                self._begin(now_ns, p, out)
        if now_ns >= self._reset_at.min():
            for p in np.flatnonzero(self._reset_at <= now_ns).tolist():  # a boot-up message begins the rest
                self._reset_at[p] = now_ns + MUTE_NS
                out.append(nmt_frame(cia.NmtCommand.RESET_NODE, self._plans[p].node_id))
        if answers or now_ns >= self._sessions.wake_ns:
            for p in answers:
                if p in self._sessions and self.table.state[p] == PatchState.ABSENT:
                    self.table.enter(p, PatchState.BOOTING)
            requests, ended = self._sessions.step(now_ns, answers)
            out += requests
            for p, result in ended:
                if isinstance(result, Provisioned):
                    self._conclude(now_ns, p, result, out, events)
                    error = result.error if result.outcome.is_good else None
                else:
                    error = result
                if p not in has_sent_emcy:  # that would be newer
                    events += self._noticed(now_ns, p, take_error(self.table, p, error))
        # Readings of started patches would slow the boots of the others down: all that are there are
        # started together. A patch is waited for once: one that reboots again and again holds nobody up.
        if self._ready and now_ns >= self._hold_until and not self._sessions.n_answering:
            for p in self._ready:
                if self._held_by[p] is None:
                    self._start_patch(now_ns, p, out, events)
                else:
                    self._hold(now_ns, p, out, events)
            self._ready.clear()
        if now_ns >= self._next_watch:
            self._next_watch = now_ns + self._watch_period
            self._watch(now_ns, events)
        return out, events

    def readings(
        self,
        now_ns: int,
        owing: npt.NDArray[np.bool_],
        fresh: npt.NDArray[np.bool_],
        bad_length: npt.NDArray[np.int32],
    ) -> list[Event]:
        """Note which of the patches that owed readings have sent them; too many gaps in a row is silence.

        ``bad_length`` (n_patches,) counts PDOs of wrong length since the start.
        """
        silent, back = self.table.note_readings(now_ns, owing, fresh, ~self._late(now_ns))
        self._retry_at[back] = self._reset_at[back] = NEVER
        self._to_ask[back] = True
        self._reset_at[silent] = now_ns + MUTE_NS
        events = [self._event(now_ns, EventKind.READINGS_LOST, p) for p in silent]
        events += [self._event(now_ns, EventKind.PATCH_BACK, p) for p in back]
        worse = bad_length != self._bad_length_seen
        if worse.any():
            events += [self._event(now_ns, EventKind.PDO_LENGTH, p) for p in np.flatnonzero(worse).tolist()]
            self._bad_length_seen[:] = bad_length
        elif self._has_bad_length.any():
            good = self._has_bad_length & fresh
            events += [
                self._event(now_ns, EventKind.PDO_LENGTH_END, p) for p in np.flatnonzero(good).tolist()
            ]
            self._has_bad_length &= ~good
        self._has_bad_length |= worse
        return events

    def _heartbeat_of(self, now_ns: int, p: int, frame: Frame, out: list[Frame], events: list[Event]) -> None:
        """Take a heartbeat or boot-up message of patch p."""
        if len(frame.data) != 1:
            return
        state = frame.data[0] & 0x7F
        self.table.heartbeat(now_ns, p, state)
        if state == cia.NmtState.INITIALISING:
            if self.table.is_running[p]:
                events.append(self._event(now_ns, EventKind.PATCH_REBOOTED, p))
            first = not self._has_booted[p]
            if first:
                self._has_booted[p] = True
                self._hold_until = now_ns + HOLD_NS
            self._begin(now_ns, p, out, is_there=first)
        elif (command := self._held_by[p]) and self.table.is_held[p]:
            if state != HELD_IN[command] and now_ns - self._started_at[p] >= START_GRACE_NS:
                out.append(nmt_frame(command, self._plans[p].node_id))
        elif state == cia.NmtState.OPERATIONAL:
            if self.table.state[p] == PatchState.ABSENT and p not in self._sessions:
                self._begin(now_ns, p, out)
        elif now_ns - self._started_at[p] < START_GRACE_NS:
            pass  # sent before the start command arrived
        elif state == cia.NmtState.STOPPED and p not in self._sessions:
            # It answers no SDO in this state; somebody has to get it out of there.
            if self.table.is_running[p]:
                events.append(self._event(now_ns, EventKind.PATCH_FELL_BACK, p, "it was stopped"))
                self.table.enter(p, PatchState.BOOTING)
            self._retry_at[p] = now_ns + RETRY_NS
            out.append(nmt_frame(cia.NmtCommand.RESET_COMMUNICATION, self._plans[p].node_id))
        elif self.table.is_running[p]:
            # It fell back without a boot-up: somebody stopped it, or its bus went away. Start over.
            detail = f"heartbeat says state 0x{state:02X}"
            events.append(self._event(now_ns, EventKind.PATCH_FELL_BACK, p, detail))
            self._begin(now_ns, p, out)

    def _begin(self, now_ns: int, p: int, out: list[Frame], *, is_there: bool = False) -> None:
        """Start (or start again) the boot of patch p."""
        if self.table.is_running[p] or self.table.is_held[p]:
            self.table.enter(p, PatchState.BOOTING)
        self._retry_at[p] = self._reset_at[p] = NEVER
        if p in self._ready:
            self._ready.remove(p)
        plan = self._plans[p]
        script = provision(plan.identity, plan.configuration, BOOT, is_restored=bool(self._is_restored[p]))
        out += self._sessions.begin(now_ns, p, plan.node_id, script, is_there=is_there)

    def _conclude(
        self, now_ns: int, p: int, result: Provisioned, out: list[Frame], events: list[Event]
    ) -> None:
        """Act on the result of a boot."""
        before, outcome = self.table.state[p], result.outcome
        if outcome.is_good or outcome is Provision.RESTORED:
            self._is_restored[p] = outcome is Provision.RESTORED
        if outcome.is_good:
            if result.n_written:
                detail = f"{result.n_written} objects"
                events.append(self._event(now_ns, EventKind.PATCH_CONFIGURED, p, detail))
            self._ready.append(p)
            return
        self._retry_at[p] = now_ns + RETRY_NS
        if outcome is Provision.RESTORED:
            out.append(nmt_frame(cia.NmtCommand.RESET_NODE, self._plans[p].node_id))
        elif outcome is Provision.REFUSED:
            self.table.enter(p, PatchState.WRONG)
            if self.table.nmt[p] == cia.NmtState.OPERATIONAL:  # somebody started it
                out.append(nmt_frame(cia.NmtCommand.PRE_OPERATIONAL, self._plans[p].node_id))
            if before != PatchState.WRONG:
                events.append(self._event(now_ns, EventKind.PATCH_REFUSED, p, result.reason))
        else:
            self.table.enter(p, PatchState.ABSENT)
            if before != PatchState.ABSENT:
                events.append(self._event(now_ns, EventKind.PATCH_LOST, p, f"no answer: {result.reason}"))

    def _start_patch(self, now_ns: int, p: int, out: list[Frame], events: list[Event]) -> None:
        self.table.enter(p, PatchState.OPERATIONAL)
        self.table.missed[p] = 0
        self.table.nmt[p] = cia.NmtState.OPERATIONAL
        self.table.last_heard[p] = self._started_at[p] = now_ns
        out.append(nmt_frame(cia.NmtCommand.START, self._plans[p].node_id))
        events.append(self._event(now_ns, EventKind.PATCH_STARTED, p))

    def _serve(self, now_ns: int, out: list[Frame], events: list[Event]) -> None:
        """Do what clients have asked for; all are commanded at once unless one of them must not be now."""
        for target, command in self._requests:
            started = self.table.is_running | self.table.is_held
            orders: list[Frame] = []
            for p in range(len(self._plans)) if target is None else (target,):
                self._order(now_ns, p, command, orders, events)
            if target is None and (command in RESETS or started.all()):
                orders = [nmt_frame(command, 0)]
            out += orders
        self._requests.clear()

    def _order(
        self, now_ns: int, p: int, command: cia.NmtCommand, out: list[Frame], events: list[Event]
    ) -> None:
        """Let patch p do what a client asks for: now, or when it may be started."""
        self._held_by[p] = command if command in HELD_IN else None
        is_held = self.table.is_held[p]
        if command in RESETS:  # its boot-up message begins the rest
            if is_held or self.table.is_running[p]:
                self.table.enter(p, PatchState.BOOTING)
            self._retry_at[p] = now_ns + RETRY_NS
            self._reset_at[p] = NEVER
            if p in self._ready:
                self._ready.remove(p)
            out.append(nmt_frame(command, self._plans[p].node_id))
        elif command in HELD_IN:
            if is_held or self.table.is_running[p]:
                self._hold(now_ns, p, out, events)
        elif is_held:
            self._start_patch(now_ns, p, out, events)
        elif self.table.is_running[p]:
            out.append(nmt_frame(command, self._plans[p].node_id))

    def _hold(self, now_ns: int, p: int, out: list[Frame], events: list[Event]) -> None:
        """Stop a patch that might be running, for a client."""
        command = self._held_by[p]
        assert command is not None
        if not self.table.is_held[p]:
            self.table.enter(p, PatchState.HELD)
            events.append(self._event(now_ns, EventKind.PATCH_HELD, p, HELD_IN[command].name))
        self._retry_at[p] = self._reset_at[p] = NEVER
        self.table.nmt[p] = HELD_IN[command]
        self.table.last_heard[p] = self._started_at[p] = now_ns
        out.append(nmt_frame(command, self._plans[p].node_id))

    def _watch(self, now_ns: int, events: list[Event]) -> None:
        """Look for heartbeats that have stopped."""
        lost = self.table.is_running & self._late(now_ns) & (self._retry_at == NEVER)
        events += [self._lose(now_ns, p, EventKind.HEARTBEAT_LOST) for p in np.flatnonzero(lost).tolist()]
        # It may have been unplugged: probe it.
        self._retry_at[lost] = now_ns + RETRY_NS
        self._reset_at[lost] = NEVER
        for p in np.flatnonzero(self.table.is_held & self._late(now_ns)).tolist():
            self.table.enter(p, PatchState.ABSENT)
            self._retry_at[p] = now_ns + RETRY_NS
            events.append(self._event(now_ns, EventKind.HEARTBEAT_LOST, p))

    def _late(self, now_ns: int) -> npt.NDArray[np.bool_]:
        """Return which patches owe a heartbeat for too long, (n_patches,)."""
        return (self._lost_after > 0) & (now_ns - self.table.last_heard > self._lost_after)

    def _lose(self, now_ns: int, p: int, kind: EventKind) -> Event:
        self.table.enter(p, PatchState.SILENT)
        return self._event(now_ns, kind, p)

    def _noticed(self, now_ns: int, p: int, noticed: Noticed | None) -> list[Event]:
        return [] if noticed is None else [self._event(now_ns, noticed[0], p, noticed[1])]

    def _event(self, now_ns: int, kind: EventKind, p: int, detail: str = "") -> Event:
        return Event(t_ns=now_ns, kind=kind, node_id=self._plans[p].node_id, detail=detail)
