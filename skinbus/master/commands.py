"""Commands of clients to the master: a zero for the tactels of one patch, or of all.

A zero is taken while something touches too: a zero that is far off looks like a touch, and it is what the
command is for. So contacts may end by it; the event says how many tactels were touched.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from canopen.objectdictionary import ObjectDictionary

from skinbus.can.event import Event, EventKind
from skinbus.estimate import Baseline
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects.cia import MAX_NODE_ID, AbortCode
from skinbus.objects.profile import COMMAND, PATCH_COMMAND, PATCH_SUSPECT, ZERO, index_of


class Commands:
    """Executes the objects "Command" and "Patch command"; shows which patches of a bus may need a zero."""

    def __init__(self, arm: Arm, bus: int, od: ObjectDictionary, device: Device, baseline: Baseline) -> None:
        self._arm = arm
        self._baseline = baseline
        self._all, _ = index_of(od, COMMAND)
        self._one, _ = index_of(od, PATCH_COMMAND)
        self._suspect = device.image_view(od[PATCH_SUSPECT.object].index, 1, MAX_NODE_ID)
        self._bus = bus
        self._patches = arm.patches_on(bus)
        self._rows = arm.node_id[self._patches] - 1
        self._zeroed: list[tuple[int, int]] = []

    def show(self) -> None:
        """Write how many tactels of each patch have been touched ever since power came."""
        count = np.add.reduceat(self._baseline.suspect, self._arm.patch_start[:-1], dtype=np.int64)
        self._suspect[self._rows] = count[self._patches]

    def obey(self, index: int, sub: int, value: Any) -> AbortCode | None:
        """Execute a write from the bus; return why it is refused, None for what is no command too."""
        if index not in (self._all, self._one):
            return None
        if value != ZERO:
            return AbortCode.NOT_STORED
        if index == self._all:
            self.zero(None, 0)
        elif sub - 1 in self._rows:
            self.zero(self._arm.patch_at(sub, self._bus), sub)
        else:
            return AbortCode.LOCAL_CONTROL
        return None

    def events(self, now_ns: int) -> list[Event]:
        """Return the events of the commands that were executed since the last call."""
        events = [
            Event(
                t_ns=now_ns,
                kind=EventKind.ZEROED,
                node_id=node_id,
                count=n,
                detail=f"{n} tactels were touched",
            )
            for node_id, n in self._zeroed
        ]
        self._zeroed.clear()
        return events

    def zero(self, patch: int | None, node_id: int) -> None:
        """Take what a patch reads now as its zero, that of all patches (node-ID 0) when None."""
        tactels = slice(None) if patch is None else self._arm.tactels_of(patch)
        self._zeroed.append((node_id, int(self._baseline.touched[tactels].sum())))
        self._baseline.zero(patch)
