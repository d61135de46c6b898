"""Supervision: boots the patches side by side, watches their heartbeats, and recovers those that return.

The states of a patch and what leads from one to another are in ``table.TRANSITIONS``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.can.core import NEVER
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.master.commissioning.sessions import Script, Sessions, Timeouts
from skinbus.master.patches.provisioning import (
    BOOT,
    Answering,
    ExpectedNode,
    Provision,
    Provisioned,
    ask_boards,
    ask_error,
    foreign_write,
    provision,
)
from skinbus.master.patches.table import HELD_IN, Mask, PatchState, PatchTable
from skinbus.node.nmt import nmt_frame
from skinbus.objects import cia
from skinbus.objects.cia import EmcyCode

STABLE_NS: Final = 30_000_000_000
"""A patch that has run for so long is stable: its next restart is at once. No longer than the longest delay,
so that one that fails once in each delay is not taken for a stable one."""

FIRST_DELAY_NS: Final = 1_000_000_000
LONGEST_DELAY_NS: Final = 30_000_000_000


class Restarts:
    """Delays of 0, 0, 1, 2, 4 ... 30 s between the starts of a patch that stops running soon after each."""

    def __init__(self, n_patches: int) -> None:
        self._n_unstable = np.zeros(n_patches, np.int64)
        self._until = np.zeros(n_patches, np.int64)

    def failed(self, now_ns: int, p: int, started_ns: int) -> int:
        """Note that patch p, started at ``started_ns``, has stopped running; return its delay (ns)."""
        n = self._n_unstable[p] = 1 if now_ns - started_ns >= STABLE_NS else self._n_unstable[p] + 1
        delay_ns = min(FIRST_DELAY_NS << min(int(n) - 2, 5), LONGEST_DELAY_NS) if n > 1 else 0
        self._until[p] = now_ns + delay_ns
        return int(delay_ns)

    def delays(self, now_ns: int, p: int) -> bool:
        """Return whether the start of patch p is put off."""
        return bool(now_ns < self._until[p])

    def forget(self, p: int | slice) -> None:
        """Start without delay: a client or a reset of the master asks for it."""
        self._n_unstable[p] = self._until[p] = 0


GRACE_NS: Final = 100_000_000
"""A heartbeat that contradicts a command so soon after was under way before: two full buses long."""


class Drains:
    """Gives the commands; separates heartbeats that follow from them from those of a patch that fell back."""

    def __init__(self, node_ids: Sequence[int]) -> None:
        self._node_ids = node_ids
        self._is_stopped = np.zeros(len(node_ids), np.bool_)
        self._commanded_ns = np.full(len(node_ids), -GRACE_NS)

    def command(self, now_ns: int, stop: Mask, start: Mask) -> list[Frame]:
        """Return the commands that stop some patches (n_patches,) and start others."""
        self._is_stopped = self._is_stopped & ~start | stop
        self._commanded_ns[stop | start] = now_ns
        commands = (cia.NmtCommand.PRE_OPERATIONAL, stop), (cia.NmtCommand.START, start)
        return [
            nmt_frame(command, self._node_ids[p])
            for command, patches in commands
            for p in np.flatnonzero(patches).tolist()
        ]

    def end(self, p: int) -> None:
        """Note that patch p was booted and started."""
        self._is_stopped[p] = False

    def explains(self, now_ns: int, p: int, state: int) -> bool:
        """Return whether a heartbeat of patch p with this state follows from the commands."""
        is_stopped = bool(self._is_stopped[p]) and state == cia.NmtState.PRE_OPERATIONAL
        return is_stopped or now_ns - int(self._commanded_ns[p]) < GRACE_NS


N_PERIODS: Final = 3
"""Periods of one board's heartbeat that are looked at: two boards send as many heartbeats in two of them."""

LEAST_SHARE: Final = 0.75
"""Of that time; half way between one board and two, so that a heartbeat may be late by most of a period."""

N_DOUBTS: Final = 3
"""Doubts that need no second answer by SDO. A single frame may come twice: CAN repeats one of which only the
sender saw an error in the last bit."""

DOUBTS_NS: Final = 10_000_000_000
"""Time within which they count."""


class Doubles:
    """Times of the newest heartbeats of each patch since it was started, and what came twice."""

    def __init__(self, periods_ns: Sequence[int]) -> None:
        self._least_ns = np.array(
            [round(LEAST_SHARE * N_PERIODS * period) for period in periods_ns], np.int64
        )
        self._times = np.zeros((len(periods_ns), N_PERIODS), np.int64)
        self._n = np.zeros(len(periods_ns), np.int64)
        self._doubts: dict[int, list[int]] = {}
        self._why: dict[int, str] = {}

    def forget(self, p: int) -> None:
        """Begin anew, as when patch p is started."""
        self._n[p] = 0
        self._doubts.pop(p, None)

    def heartbeat(self, p: int, t_ns: int) -> bool:
        """Take a heartbeat of patch p; return whether they come too often for one board."""
        n = int(self._n[p])
        oldest = self._times[p, n % N_PERIODS]
        self._times[p, n % N_PERIODS] = t_ns
        self._n[p] = n + 1
        return bool(n >= N_PERIODS and t_ns - oldest < self._least_ns[p])

    def doubt(self, now_ns: int, p: int, why: str) -> None:
        """Note that something of patch p came twice."""
        self._n[p] = 0
        self._why[p] = why
        self._doubts[p] = [t for t in self._doubts.get(p, ()) if now_ns - t < DOUBTS_NS] + [now_ns]

    def certain(self, p: int) -> str:
        """Return what came twice, too often to be chance; else nothing."""
        return self._why[p] if len(self._doubts.get(p, ())) >= N_DOUBTS else ""


EMCY_LENGTH: Final = 8

FIRST_ERROR: Final = 0x0100
"""EMCY codes below report that an error was reset, or that there is none (CiA 301, table 26)."""

Reported = tuple[EventKind, str]
"""What is new of a patch, and the detail of its event."""


def take_emcy(table: PatchTable, p: int, frame: Frame) -> Reported | None:
    """Take an EMCY of patch p; code 0x00xx says that an error is over, the register whether any is left.

    Which one is over it does not say (CiA 301, 7.2.7.1): the last code stays until all are.
    """
    code, register = int.from_bytes(frame.data[:2], "little"), frame.data[2]
    if code >= FIRST_ERROR:
        table.error[p] = code
        return EventKind.PATCH_EMCY, f"0x{code:04X}"
    if not register:
        table.error[p] = EmcyCode.NO_ERROR
        return EventKind.PATCH_EMCY_CLEARED, ""
    if table.error[p]:
        return None
    table.error[p] = EmcyCode.GENERIC  # an error whose EMCY was not received
    return EventKind.PATCH_EMCY, f"error register 0x{register:02X}"


def take_error(table: PatchTable, p: int, code: int | None) -> Reported | None:
    """Take what patch p answered: code of its last error, GENERIC for any, 0 for none, None: no answer."""
    before = table.error[p]
    if code is None or code == before or (before and code == EmcyCode.GENERIC):
        return None
    table.error[p] = code
    return (EventKind.PATCH_EMCY, f"0x{code:04X}") if code else (EventKind.PATCH_EMCY_CLEARED, "")


class Lengths:
    """Notes which patches send PDOs of a wrong length, and which no longer do."""

    def __init__(self, n_patches: int) -> None:
        self._seen = np.zeros(n_patches, np.int32)
        self._is_wrong = np.zeros(n_patches, np.bool_)

    def note(self, bad_length: npt.NDArray[np.int32], fresh: Mask) -> tuple[list[int], list[int]]:
        """Return the patches that have sent more of them since, and those whose readings are good again.

        bad_length: (n_patches,) PDOs of wrong length since the start.
        fresh:      (n_patches,) whether readings of the newest cycle are used.
        """
        worse = bad_length != self._seen
        if not (worse.any() or self._is_wrong.any()):
            return [], []
        good = self._is_wrong & fresh & (not worse.any())
        self._seen[:] = bad_length
        self._is_wrong = self._is_wrong & ~good | worse
        return np.flatnonzero(worse).tolist(), np.flatnonzero(good).tolist()


HOLD_NS: Final = 20_000_000
"""No patch is started so soon after the first boot-up message of another: on the wire these give way to SDO,
so those of many boards that start together come one by one; 20 frame times at 125 kbit/s."""

Ended = Provisioned | Answering | int | None
"""What a session returned: of a boot, of a question for the boards of a node-ID, or for errors."""


class Boots:
    """Sessions by patch.

    Readings of started patches would slow the boots of the others down: all that are there are started
    together. A patch is waited for once: one that reboots again and again delays no other.
    """

    def __init__(self, plans: Sequence[ExpectedNode], timeouts: Timeouts | None) -> None:
        self._plans = tuple(plans)
        self._sessions: Sessions[Ended] = Sessions(timeouts)
        self._ready: list[int] = []
        self._has_booted = np.zeros(len(plans), np.bool_)
        self._is_restored = np.zeros(len(plans), np.bool_)  # to its defaults, and not accepted since
        self._hold_until = 0

    def __contains__(self, p: int) -> bool:
        return p in self._sessions

    @property
    def wake_ns(self) -> int:
        """Time of the next thing to do (ns)."""
        hold = self._hold_until if self._ready and not self._sessions.n_answering else NEVER
        return min(self._sessions.wake_ns, hold)

    def clear(self) -> None:
        """Drop all, as when the master is reset."""
        self._sessions.clear()
        self._ready.clear()
        self._has_booted[:] = False

    def drop(self, p: int) -> None:
        """Drop the boot of patch p."""
        self._sessions.drop(p)
        if p in self._ready:
            self._ready.remove(p)

    def begin(self, now_ns: int, p: int, *, has_sent_boot_up: bool = False) -> list[Frame]:
        """Begin, or begin anew, the boot of patch p; return its first frames."""
        is_first = has_sent_boot_up and not self._has_booted[p]
        if is_first:
            self._has_booted[p] = True
            self._hold_until = now_ns + HOLD_NS
        self.drop(p)
        plan = self._plans[p]
        script = provision(plan, BOOT, is_restored=bool(self._is_restored[p]))
        return self._sessions.begin(now_ns, p, plan.node_id, script, is_there=is_first)

    def ask(self, now_ns: int, p: int, script: Script[Ended]) -> list[Frame]:
        """Begin another script with patch p; return its first frames."""
        return self._sessions.begin(now_ns, p, self._plans[p].node_id, script)

    def step(
        self, now_ns: int, answers: Mapping[int, Sequence[Frame]]
    ) -> tuple[list[Frame], list[tuple[int, Ended]]]:
        """Take SDO answers by patch; return frames to send, and what has ended."""
        if not answers and now_ns < self._sessions.wake_ns:
            return [], []
        out, ended = self._sessions.step(now_ns, answers)
        for p, result in ended:
            if isinstance(result, Provisioned):
                if result.outcome.is_good or result.outcome is Provision.RESTORED:
                    self._is_restored[p] = not result.outcome.is_good
                if result.outcome.is_good:
                    self._ready.append(p)
        return out, ended

    def take_ready(self, now_ns: int) -> list[int]:
        """Return the patches that are to be started now."""
        if not self._ready or now_ns < self._hold_until or self._sessions.n_answering:
            return []
        ready, self._ready = self._ready, []
        return ready


RETRY_NS = 1_000_000_000
"""Pause between attempts to reach a patch that does not answer: long against a boot."""

HEARTBEAT_FACTOR = 3.0
"""A patch is lost after this many heartbeat periods; the factor of lely's dcfgen (heartbeat_multiplier)."""

MUTE_NS = 5_000_000_000
"""A patch that lives but sends no readings for so long is reset: long against a boot and a passing fault."""

RESETS = (cia.NmtCommand.RESET_NODE, cia.NmtCommand.RESET_COMMUNICATION)

REFUSALS = {Provision.REFUSED: EventKind.PATCH_REFUSED, Provision.DOUBLED: EventKind.PATCH_DOUBLED}


class Supervisor:
    """Owns the state of every patch; frames and time in, frames and events out."""

    def __init__(
        self, plans: Sequence[ExpectedNode], table: PatchTable, timeouts: Timeouts | None = None
    ) -> None:
        self.table = table
        self._plans = tuple(plans)
        node_ids = [plan.node_id for plan in plans]
        self._lost_after = np.array([round(HEARTBEAT_FACTOR * plan.heartbeat_ns) for plan in plans], np.int64)
        self._retry_at = np.full(len(plans), NEVER, np.int64)
        self._reset_at = np.full(len(plans), NEVER, np.int64)
        self._started_at = np.zeros(len(plans), np.int64)
        self._drains = Drains(node_ids)
        self._next_watch = NEVER
        self._boots = Boots(plans, timeouts)
        self._restarts = Restarts(len(plans))
        self._doubles = Doubles([plan.heartbeat_ns for plan in plans])
        self._is_lost = np.zeros(len(plans), np.bool_)  # as the log has it: "back" follows
        self._is_bus_lost = False
        self._out: list[Frame] = []
        self._events: list[Event] = []
        self._to_ask = np.zeros(len(plans), np.bool_)  # for errors: an EMCY may have been lost
        self._held_by: list[cia.NmtCommand | None] = [None] * len(plans)
        self._requests: list[tuple[int | None, cia.NmtCommand]] = []
        self._lengths = Lengths(len(plans))
        bases = (cia.SDO_SERVER_BASE, cia.HEARTBEAT_BASE, cia.EMCY_BASE, cia.SDO_CLIENT_BASE)
        self._sender = {base + n: (base, p) for base in bases for p, n in enumerate(node_ids)}
        """By identifier: which service of which patch."""
        self.cob_ids = frozenset(self._sender)
        watched = self._lost_after[self._lost_after > 0]
        # Four times per time-out: a loss is detected at most a quarter of it late.
        self._watch_period = int(watched.min()) // 4 if len(watched) else NEVER

    def start(self, now_ns: int) -> list[Frame]:
        """Begin: every node goes through its boot-up, whatever it was doing before."""
        for p in np.flatnonzero(self.table.is_running | self.table.is_held).tolist():
            self.table.enter(p, PatchState.ABSENT)
        self._boots.clear()
        self._held_by[:] = [None] * len(self._plans)
        self._requests.clear()
        self.table.error[:] = 0  # each patch is asked for its errors at its boot
        self._is_lost[:] = False
        self._restarts.forget(slice(None))
        self._retry_at[:] = now_ns + RETRY_NS
        self._reset_at[:] = NEVER
        self._next_watch = now_ns + self._watch_period if self._watch_period < NEVER else NEVER
        return [nmt_frame(cia.NmtCommand.RESET_COMMUNICATION, 0)]

    def bus_is_lost(self) -> None:
        """Suspend supervision until the bus is back: silence proves nothing about a patch now."""
        self._is_bus_lost = True

    def bus_is_back(self, now_ns: int) -> None:
        """Resume: no patch is late for what was lost, and what was asked then is asked again."""
        self._is_bus_lost, self.table.last_heard[:] = False, now_ns
        silent = self.table.state == PatchState.SILENT
        self._retry_at[silent], self._reset_at[silent] = NEVER, now_ns + MUTE_NS  # readings suffice
        unheard = np.array([p in self._boots for p in range(len(self._retry_at))]) & ~self.table.is_running
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
        return min(
            int(self._retry_at.min()), int(self._reset_at.min()), self._next_watch, self._boots.wake_ns
        )

    def step(self, now_ns: int, frames: Sequence[Frame]) -> tuple[list[Frame], list[Event]]:
        """Take control-plane frames; return frames to send, and events."""
        answers: dict[int, list[Frame]] = {}
        has_sent_emcy: set[int] = set()
        if self._is_bus_lost:
            return [], []
        for frame in frames:
            base, p = self._sender.get(frame.can_id, (0, 0))
            if base == cia.SDO_SERVER_BASE:
                answers.setdefault(p, []).append(frame)
            elif base == cia.HEARTBEAT_BASE:
                self._heartbeat_of(now_ns, p, frame)
            elif base == cia.EMCY_BASE and len(frame.data) == EMCY_LENGTH:
                has_sent_emcy.add(p)
                self._note(now_ns, p, take_emcy(self.table, p, frame))
            elif base == cia.SDO_CLIENT_BASE and (what := foreign_write(frame.data)):
                self._fall(now_ns, p, f"another client writes {what}", RETRY_NS)
        if self._requests:
            self._serve(now_ns)
        if self._to_ask.any():
            for p in np.flatnonzero(self._to_ask & self.table.is_running).tolist():
                self._out += self._boots.ask(now_ns, p, ask_error())
            self._to_ask[:] = False
        if now_ns >= self._retry_at.min():
            for p in np.flatnonzero(self._retry_at <= now_ns).tolist():
                self._begin(now_ns, p)
        if now_ns >= self._reset_at.min():
            for p in np.flatnonzero(self._reset_at <= now_ns).tolist():  # a boot-up message begins the rest
                self._reset_at[p] = now_ns + MUTE_NS
                self._command(p, cia.NmtCommand.RESET_NODE)
        for p in answers:
            if p in self._boots and self.table.state[p] == PatchState.ABSENT:
                self.table.enter(p, PatchState.BOOTING)
        requests, ended = self._boots.step(now_ns, answers)
        self._out += requests
        for p, result in ended:
            error = self._conclude(now_ns, p, result)
            if p not in has_sent_emcy:  # that would be newer
                self._note(now_ns, p, take_error(self.table, p, error))
        for p in self._boots.take_ready(now_ns):
            if self._held_by[p] is None:
                self._start_patch(now_ns, p)
            else:
                self._hold(now_ns, p)
        if now_ns >= self._next_watch:
            self._next_watch = now_ns + self._watch_period
            self._watch(now_ns)
        return self._taken()

    def readings(
        self,
        now_ns: int,
        owing: Mask,
        fresh: Mask,
        bad_length: npt.NDArray[np.int32],
    ) -> list[Event]:
        """Note which of the patches that owed readings have sent them; too many gaps in a row is silence.

        ``bad_length`` (n_patches,) counts PDOs of wrong length since the start.
        """
        silent, back = self.table.note_readings(owing, fresh, ~self._late(now_ns))
        self._retry_at[back] = self._reset_at[back] = NEVER
        self._to_ask[back] = True
        self._reset_at[silent] = now_ns + MUTE_NS
        self._is_lost[silent], self._is_lost[back] = True, False
        self._report(now_ns, EventKind.READINGS_LOST, *silent)
        self._report(now_ns, EventKind.PATCH_BACK, *back)
        worse, good = self._lengths.note(bad_length, fresh)
        self._report(now_ns, EventKind.PDO_LENGTH, *worse)
        self._report(now_ns, EventKind.PDO_LENGTH_END, *good)
        return self._taken()[1]

    def drain(self, now_ns: int, stop: Mask, start: Mask) -> list[Frame]:
        """Stop patches (n_patches,) until nothing of theirs is under way, or start them; return frames."""
        return self._drains.command(now_ns, stop, start)

    def doubled(self, now_ns: int, patches: Mask) -> tuple[list[Frame], list[Event]]:
        """Take patches (n_patches,) whose readings came twice; they are asked which boards they are."""
        for p in np.flatnonzero(patches).tolist():
            self._doubt(now_ns, p, "readings came twice in a cycle: two boards?")
        return self._taken()

    def _doubt(self, now_ns: int, p: int, why: str) -> None:
        """Ask which boards answer under the node-ID of patch p, because something came twice."""
        if self.table.is_running[p] and p not in self._boots:
            self._doubles.doubt(now_ns, p, why)
            self._out += self._boots.ask(now_ns, p, ask_boards(self._plans[p].node_id))

    def _heartbeat_of(self, now_ns: int, p: int, frame: Frame) -> None:
        """Take a heartbeat or boot-up message of patch p."""
        if len(frame.data) != 1:
            return
        state = frame.data[0] & 0x7F
        self.table.heartbeat(now_ns, p, state)
        if state == cia.NmtState.INITIALISING:
            if self.table.is_running[p]:
                self._fell(now_ns, p, EventKind.PATCH_REBOOTED)
            if not self._restarts.delays(now_ns, p):
                self._begin(now_ns, p, has_sent_boot_up=True)
        elif (command := self._held_by[p]) and self.table.is_held[p]:
            if state != HELD_IN[command] and now_ns - self._started_at[p] >= GRACE_NS:
                self._command(p, command)
        elif state == cia.NmtState.OPERATIONAL:
            if self.table.state[p] == PatchState.ABSENT and p not in self._boots:
                self._begin(now_ns, p)
            elif self._doubles.heartbeat(p, frame.t_ns or now_ns):
                self._doubt(now_ns, p, "heartbeats come twice as often as configured: two boards?")
        elif now_ns - self._started_at[p] < GRACE_NS or self._drains.explains(now_ns, p, state):
            pass  # sent before the command arrived, or as commanded
        elif state == cia.NmtState.STOPPED and p not in self._boots:
            # It answers no SDO in this state; somebody has to get it out of there.
            if self.table.is_running[p]:
                self._report(now_ns, EventKind.PATCH_FELL_BACK, p, detail="it was stopped")
                self.table.enter(p, PatchState.BOOTING)
            self._retry_at[p] = now_ns + RETRY_NS
            self._command(p, cia.NmtCommand.RESET_COMMUNICATION)
        else:  # it fell back without a boot-up: somebody stopped it, or its bus went away
            self._fall(now_ns, p, f"heartbeat with state 0x{state:02X}")

    def _fall(self, now_ns: int, p: int, detail: str, pause_ns: int = 0) -> None:
        """Boot patch p again, if it runs; after a pause where requests of another client might collide."""
        if not self.table.is_running[p]:
            return
        self._fell(now_ns, p, EventKind.PATCH_FELL_BACK, detail)
        if pause_ns:
            self._retry_at[p] = now_ns + pause_ns
        elif not self._restarts.delays(now_ns, p):
            self._begin(now_ns, p)

    def _fell(self, now_ns: int, p: int, kind: EventKind, detail: str = "") -> None:
        """Note that patch p no longer runs; if it does so time and again it is booted later, not at once."""
        self.table.restarts[p] += 1
        delay_ns = self._restarts.failed(now_ns, p, int(self._started_at[p]))
        if delay_ns:
            delay = f"restart {self.table.restarts[p]}, in {delay_ns / 1e9:g} s"
            detail = f"{detail}; {delay}" if detail else delay
        self._report(now_ns, kind, p, detail=detail)
        self.table.enter(p, PatchState.BOOTING)
        self._boots.drop(p)
        self._reset_at[p] = NEVER
        self._retry_at[p] = now_ns + delay_ns if delay_ns else NEVER

    def _begin(self, now_ns: int, p: int, *, has_sent_boot_up: bool = False) -> None:
        """Start (or start again) the boot of patch p."""
        if self.table.is_running[p] or self.table.is_held[p]:
            self.table.enter(p, PatchState.BOOTING)
        self._retry_at[p] = self._reset_at[p] = NEVER
        self._out += self._boots.begin(now_ns, p, has_sent_boot_up=has_sent_boot_up)

    def _conclude(self, now_ns: int, p: int, result: Ended) -> int | None:
        """Act on the result of a session; return the patch's error, None if it is not known."""
        if isinstance(result, Answering):
            detail = str(result) if len(result.serials) > 1 else self._doubles.certain(p)
            if detail:
                self._refuse(now_ns, p, EventKind.PATCH_DOUBLED, detail)
            return None
        if not isinstance(result, Provisioned):
            return result
        before, outcome = self.table.state[p], result.outcome
        if result.n_written and outcome.is_good:
            self._report(now_ns, EventKind.PATCH_CONFIGURED, p, detail=f"{result.n_written} objects")
        if outcome.is_good:
            return result.error
        self._retry_at[p] = now_ns + RETRY_NS
        if outcome is Provision.RESTORED:
            self._command(p, cia.NmtCommand.RESET_NODE)
        elif outcome in REFUSALS:
            self._refuse(now_ns, p, REFUSALS[outcome], result.reason)
        else:
            self.table.enter(p, PatchState.ABSENT)
            if before != PatchState.ABSENT or not self._is_lost[p]:
                self._report(now_ns, EventKind.PATCH_LOST, p, detail=result.reason)
            self._is_lost[p] = True
        return None

    def _refuse(self, now_ns: int, p: int, kind: EventKind, reason: str) -> None:
        """Do not let patch p run, and look at it again later."""
        self._retry_at[p] = now_ns + RETRY_NS
        if self.table.nmt[p] == cia.NmtState.OPERATIONAL:
            self._command(p, cia.NmtCommand.PRE_OPERATIONAL)
        if self.table.state[p] != PatchState.WRONG:
            self.table.enter(p, PatchState.WRONG)
            self._report(now_ns, kind, p, detail=reason)

    def _start_patch(self, now_ns: int, p: int) -> None:
        self._drains.end(p)
        self.table.enter(p, PatchState.OPERATIONAL)
        self.table.missed[p] = 0
        self.table.nmt[p] = cia.NmtState.OPERATIONAL
        self.table.last_heard[p] = self._started_at[p] = now_ns
        self._doubles.forget(p)
        self._command(p, cia.NmtCommand.START)
        self._report(now_ns, EventKind.PATCH_STARTED, p)
        if self._is_lost[p]:
            self._is_lost[p] = False
            self._report(now_ns, EventKind.PATCH_BACK, p)

    def _serve(self, now_ns: int) -> None:
        """Do what clients have asked for; all are commanded at once unless one of them must not be now."""
        for target, command in self._requests:
            started = self.table.is_running | self.table.is_held
            n_before = len(self._out)
            for p in range(len(self._plans)) if target is None else (target,):
                self._order(now_ns, p, command)
            if target is None and (command in RESETS or started.all()):
                self._out[n_before:] = [nmt_frame(command, 0)]
        self._requests.clear()

    def _order(self, now_ns: int, p: int, command: cia.NmtCommand) -> None:
        """Let patch p do what a client asks for: now, or when it may be started."""
        self._held_by[p] = command if command in HELD_IN else None
        self._restarts.forget(p)
        is_held = self.table.is_held[p]
        if command in RESETS:  # its boot-up message begins the rest
            if is_held or self.table.is_running[p]:
                self.table.enter(p, PatchState.BOOTING)
            self._retry_at[p] = now_ns + RETRY_NS
            self._reset_at[p] = NEVER
            self._boots.drop(p)
            self._command(p, command)
        elif command in HELD_IN:
            if is_held or self.table.is_running[p]:
                self._hold(now_ns, p)
        elif is_held:
            self._start_patch(now_ns, p)
        elif self.table.is_running[p]:
            self._command(p, command)

    def _hold(self, now_ns: int, p: int) -> None:
        """Stop a patch that might be running, for a client."""
        command = self._held_by[p]
        assert command is not None
        if not self.table.is_held[p]:
            self.table.enter(p, PatchState.HELD)
            self._report(now_ns, EventKind.PATCH_HELD, p, detail=HELD_IN[command].name)
        self._retry_at[p] = self._reset_at[p] = NEVER
        self.table.nmt[p] = HELD_IN[command]
        self.table.last_heard[p] = self._started_at[p] = now_ns
        self._command(p, command)

    def _watch(self, now_ns: int) -> None:
        """Look for heartbeats that have stopped."""
        lost = self.table.is_running & self._late(now_ns) & (self._retry_at == NEVER)
        for p in np.flatnonzero(lost).tolist():
            self.table.enter(p, PatchState.SILENT)
            self._is_lost[p] = True
            self._report(now_ns, EventKind.HEARTBEAT_LOST, p)
        # It may have been unplugged: probe it.
        self._retry_at[lost] = now_ns + RETRY_NS
        self._reset_at[lost] = NEVER
        for p in np.flatnonzero(self.table.is_held & self._late(now_ns)).tolist():
            self.table.enter(p, PatchState.ABSENT)
            self._retry_at[p] = now_ns + RETRY_NS
            self._is_lost[p] = True
            self._report(now_ns, EventKind.HEARTBEAT_LOST, p)

    def _late(self, now_ns: int) -> Mask:
        """Return which patches owe a heartbeat for too long, (n_patches,)."""
        return (self._lost_after > 0) & (now_ns - self.table.last_heard > self._lost_after)

    def _command(self, p: int, command: cia.NmtCommand) -> None:
        self._out.append(nmt_frame(command, self._plans[p].node_id))

    def _note(self, now_ns: int, p: int, reported: Reported | None) -> None:
        if reported is not None:
            self._report(now_ns, reported[0], p, detail=reported[1])

    def _report(self, now_ns: int, kind: EventKind, *patches: int, detail: str = "") -> None:
        self._events += [
            Event(t_ns=now_ns, kind=kind, node_id=self._plans[p].node_id, detail=detail) for p in patches
        ]

    def _taken(self) -> tuple[list[Frame], list[Event]]:
        """Return what is to be sent, and events, since the last call."""
        out, events, self._out, self._events = self._out, self._events, [], []
        return out, events
