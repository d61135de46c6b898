"""Supervision: boots the patches side by side, watches their heartbeats, and brings back what returns.

Per patch::

    ABSENT ──answers──► BOOTING ──accepted──► OPERATIONAL ◄──readings──► SILENT
       ▲                  │  └──refused──► WRONG                          │
       └───no answer──────┘       any state ──boot-up message──► BOOTING ◄┘
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skinbus.bus.core import NEVER, Event
from skinbus.bus.frame import Frame
from skinbus.master.boot import Boot, Identity, Reply, Request, Verdict, boot
from skinbus.master.patches import PatchState, PatchTable
from skinbus.node.sdo_client import SdoClient
from skinbus.objects import cia

RETRY_NS = 1_000_000_000
"""Pause between attempts to reach a patch that does not answer: long against a boot, short for people."""

HEARTBEAT_FACTOR = 3.0
"""A patch is lost after this many heartbeat periods; the factor of lely's dcfgen (heartbeat_multiplier)."""

START_GRACE_NS = 100_000_000
"""A heartbeat that contradicts a start command so soon after was under way before: two full buses long."""

MAX_MISSED = 3
"""Cycles in a row without readings after which an operational patch is SILENT: one lost frame is no alarm."""


@dataclass(slots=True)
class _Conversation:
    """The boot of one patch that is under way."""

    script: Boot
    client: SdoClient


class Supervisor:
    """Owns the state of every patch; frames and time in, frames and events out."""

    def __init__(
        self,
        node_ids: Sequence[int],
        identities: Sequence[Identity],
        heartbeat_ns: npt.NDArray[np.int64],
        table: PatchTable,
    ) -> None:
        """``heartbeat_ns`` (n_patches,): producer time of each patch, 0 where it has none."""
        self.table = table
        self._identities = tuple(identities)
        self._node_ids = tuple(node_ids)
        self._lost_after = (heartbeat_ns * HEARTBEAT_FACTOR).astype(np.int64)
        self._retry_at = np.full(len(node_ids), NEVER, np.int64)
        self._started_at = np.zeros(len(node_ids), np.int64)
        self._next_watch = NEVER
        self._conversations: dict[int, _Conversation] = {}
        self._client_of: dict[int, SdoClient] = {}
        self._sdo_rx = {cia.SDO_SERVER_BASE + node_id: p for p, node_id in enumerate(node_ids)}
        self._heartbeat = {cia.HEARTBEAT_BASE + node_id: p for p, node_id in enumerate(node_ids)}
        self._emcy = {cia.EMCY_BASE + node_id: p for p, node_id in enumerate(node_ids)}
        self.cob_ids = frozenset(self._sdo_rx) | frozenset(self._heartbeat) | frozenset(self._emcy)
        watched = self._lost_after[self._lost_after > 0]
        # Looked at four times per time-out: a loss is noticed at most a quarter of it late.
        self._watch_period = int(watched.min()) // 4 if len(watched) else NEVER

    def start(self, now_ns: int) -> list[Frame]:
        """Begin: every node goes through its boot-up, whatever it was doing before."""
        self._retry_at[:] = now_ns + RETRY_NS
        self._next_watch = now_ns + self._watch_period if self._watch_period < NEVER else NEVER
        return [Frame(cia.NMT_COMMAND_ID, bytes([cia.NmtCommand.RESET_COMMUNICATION, 0]))]

    @property
    def wake_ns(self) -> int:
        """Time of the next thing to do (ns)."""
        wake = min(int(self._retry_at.min()), self._next_watch)
        return min([wake, *(talk.client.wake_ns for talk in self._conversations.values())])

    def step(self, now_ns: int, frames: Sequence[Frame]) -> tuple[list[Frame], list[Event]]:
        """Take control-plane frames; return frames to send and what was noticed."""
        out: list[Frame] = []
        events: list[Event] = []
        replies: dict[int, list[Frame]] = {}
        for frame in frames:
            if (p := self._sdo_rx.get(frame.can_id)) is not None:
                replies.setdefault(p, []).append(frame)
            elif (p := self._heartbeat.get(frame.can_id)) is not None:
                self._heard(now_ns, p, frame, out, events)
            elif (p := self._emcy.get(frame.can_id)) is not None and len(frame.data) == 8:
                self.table.error[p] = int.from_bytes(frame.data[:2], "little")
                text = f"EMCY 0x{self.table.error[p]:04X}"
                events.append(Event(t_ns=now_ns, kind="patch-emcy", node_id=self._node_ids[p], detail=text))
        for p in np.flatnonzero(self._retry_at <= now_ns).tolist():
            self._begin(now_ns, p, out)
        for p in list(self._conversations):
            if p in replies or self._conversations[p].client.wake_ns <= now_ns:
                self._advance(now_ns, p, replies.get(p, ()), out, events)
        if now_ns >= self._next_watch:
            self._next_watch = now_ns + self._watch_period
            self._watch(now_ns, events)
        return out, events

    def readings(
        self, now_ns: int, owing: npt.NDArray[np.bool_], fresh: npt.NDArray[np.bool_]
    ) -> list[Event]:
        """Note which patches that owed readings have sent them; too many gaps in a row is silence."""
        table = self.table
        table.last_fresh[fresh] = now_ns
        table.missed[fresh] = 0
        table.missed[owing & ~fresh] += 1
        silent = (table.state == PatchState.OPERATIONAL) & (table.missed >= MAX_MISSED)
        back = (table.state == PatchState.SILENT) & fresh & ~self._late(now_ns)
        table.state[back] = PatchState.OPERATIONAL
        events = [self._lose(now_ns, p, "readings-lost") for p in np.flatnonzero(silent).tolist()]
        for p in np.flatnonzero(back).tolist():
            events.append(Event(t_ns=now_ns, kind="patch-back", node_id=self._node_ids[p]))
        return events

    def _heard(self, now_ns: int, p: int, frame: Frame, out: list[Frame], events: list[Event]) -> None:
        """Take a heartbeat or boot-up message of patch p."""
        if len(frame.data) != 1:
            return
        self.table.last_heard[p] = now_ns
        state = frame.data[0] & 0x7F
        if state == cia.NmtState.INITIALISING:
            self._begin(now_ns, p, out)
        elif state == cia.NmtState.OPERATIONAL:
            if self.table.state[p] == PatchState.ABSENT and p not in self._conversations:
                self._begin(now_ns, p, out)
        elif now_ns - self._started_at[p] < START_GRACE_NS:
            pass  # sent before the start command arrived
        elif self.table.state[p] in (PatchState.OPERATIONAL, PatchState.SILENT):
            # It fell back without a boot-up: somebody stopped it, or its bus went away. Start over.
            detail = f"heartbeat says state 0x{state:02X}"
            events.append(
                Event(t_ns=now_ns, kind="patch-fell-back", node_id=self._node_ids[p], detail=detail)
            )
            self._begin(now_ns, p, out)

    def _begin(self, now_ns: int, p: int, out: list[Frame]) -> None:
        """Start (or start again) the boot of patch p."""
        if self.table.state[p] in (PatchState.OPERATIONAL, PatchState.SILENT):
            self.table.state[p] = PatchState.BOOTING
        self._retry_at[p] = NEVER
        talk = _Conversation(boot(self._identities[p]), SdoClient(self._node_ids[p]))
        self._conversations[p] = talk
        self._request(now_ns, talk, next(talk.script), out)

    def _advance(
        self, now_ns: int, p: int, frames: Sequence[Frame], out: list[Frame], events: list[Event]
    ) -> None:
        """Feed the conversation with patch p; go on to its next request or its verdict."""
        talk = self._conversations[p]
        out += talk.client.step(now_ns, frames)
        result = talk.client.result
        if result is None:
            return
        if result.abort is None and self.table.state[p] == PatchState.ABSENT:
            self.table.state[p] = PatchState.BOOTING
        try:
            request = talk.script.send(Reply(result.data, result.abort or 0))
        except StopIteration as end:
            del self._conversations[p]
            self._conclude(now_ns, p, end.value, out, events)
        else:
            self._request(now_ns, talk, request, out)

    def _request(self, now_ns: int, talk: _Conversation, request: Request, out: list[Frame]) -> None:
        if request.data is None:
            talk.client.start_read(request.index, request.sub)
        else:
            talk.client.start_write(request.index, request.sub, request.data)
        out += talk.client.step(now_ns, ())

    def _conclude(self, now_ns: int, p: int, verdict: Verdict, out: list[Frame], events: list[Event]) -> None:
        """Act on the verdict of a boot: start the patch, refuse it, or try again later."""
        node_id = self._node_ids[p]
        if verdict.accepted:
            self.table.state[p] = PatchState.OPERATIONAL
            self.table.missed[p] = 0
            self._started_at[p] = now_ns
            self.table.last_heard[p] = now_ns
            out.append(Frame(cia.NMT_COMMAND_ID, bytes([cia.NmtCommand.START, node_id])))
            events.append(Event(t_ns=now_ns, kind="patch-started", node_id=node_id))
            return
        first = self.table.state[p] not in (PatchState.ABSENT, PatchState.WRONG)
        self.table.state[p] = PatchState.WRONG if verdict.answered else PatchState.ABSENT
        self._retry_at[p] = now_ns + RETRY_NS
        if first:
            kind = "patch-refused" if verdict.answered else "patch-lost"
            events.append(Event(t_ns=now_ns, kind=kind, node_id=node_id, detail=verdict.reason))

    def _watch(self, now_ns: int, events: list[Event]) -> None:
        """Look for heartbeats that have stopped."""
        table = self.table
        late = self._late(now_ns)
        for p in np.flatnonzero(late & (table.state == PatchState.OPERATIONAL)).tolist():
            events.append(self._lose(now_ns, p, "heartbeat-lost"))
        # A patch that is silent and whose heartbeat is gone as well may have been unplugged: probe it.
        gone = late & (table.state == PatchState.SILENT) & (self._retry_at == NEVER)
        self._retry_at[gone] = now_ns + RETRY_NS

    def _late(self, now_ns: int) -> npt.NDArray[np.bool_]:
        """Return which patches owe a heartbeat for too long, (n_patches,)."""
        return (self._lost_after > 0) & (now_ns - self.table.last_heard > self._lost_after)

    def _lose(self, now_ns: int, p: int, kind: str) -> Event:
        self.table.state[p] = PatchState.SILENT
        return Event(t_ns=now_ns, kind=kind, node_id=self._node_ids[p])
