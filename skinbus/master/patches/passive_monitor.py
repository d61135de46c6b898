"""Passive monitoring: the states of patches from the frames on their bus alone; nothing is sent.

It takes the place of the supervisor when another master has booted the patches. A patch is assumed to be
operational until the bus shows otherwise: reception may have begun in the middle. One that boots, by its
boot-up message or an NMT command, owes no readings until it is started, reports it in its heartbeat, or
sends readings.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.can.core import NEVER
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.master.patches.table import Mask, PatchState, PatchTable
from skinbus.node.nmt import command_for
from skinbus.objects import cia

AFTER: Final = {
    cia.NmtCommand.START: PatchState.OPERATIONAL,
    cia.NmtCommand.STOP: PatchState.BOOTING,
    cia.NmtCommand.PRE_OPERATIONAL: PatchState.BOOTING,
    cia.NmtCommand.RESET_NODE: PatchState.BOOTING,
    cia.NmtCommand.RESET_COMMUNICATION: PatchState.BOOTING,
}
"""What a patch is after an NMT command: one that is not operational has to be booted again."""


class PassiveMonitor:
    """A monitor that only listens."""

    wake_ns: int = NEVER

    def __init__(self, node_ids: Sequence[int], table: PatchTable) -> None:
        self._node_ids = tuple(node_ids)
        self._table = table
        self._heartbeat = {cia.HEARTBEAT_BASE + node_id: p for p, node_id in enumerate(node_ids)}
        self.cob_ids = frozenset(self._heartbeat) | {cia.NMT_COMMAND_ID}
        table.state[:] = PatchState.OPERATIONAL

    def start(self, now_ns: int) -> list[Frame]:
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

    def drain(self, now_ns: int, stop: Mask, start: Mask) -> list[Frame]:
        """Nothing: another master commands the patches."""
        return []

    def doubled(self, now_ns: int, patches: Mask) -> tuple[list[Frame], list[Event]]:
        """Report them: which boards they are is not asked."""
        found = np.flatnonzero(patches).tolist()
        return [], [
            Event(t_ns=now_ns, kind=EventKind.PATCH_DOUBLED, node_id=self._node_ids[p]) for p in found
        ]

    def request(self, p: int | None, command: cia.NmtCommand) -> cia.AbortCode | None:
        """Refuse: another master commands them."""
        return cia.AbortCode.LOCAL_CONTROL

    def bus_is_lost(self) -> None:
        """A recording does not report it; the patches fall silent."""

    def bus_is_back(self, now_ns: int) -> None:
        """They send again."""

    def _heartbeat_of(self, now_ns: int, p: int, state: int) -> None:
        self._table.heartbeat(now_ns, p, state)
        if state == cia.NmtState.INITIALISING:
            self._enter(p, PatchState.BOOTING)
        elif state == cia.NmtState.OPERATIONAL and not self._table.is_running[p]:
            self._enter(p, PatchState.OPERATIONAL)

    def _enter(self, p: int, state: PatchState) -> None:
        self._table.enter(p, state)
        self._table.missed[p] = 0
