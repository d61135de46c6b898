"""Tactels that are not plausible, published: bit maps and counts as objects, an EMCY and an event.

A patch whose readings come again, or are those of another, is an event, too: such a cycle is not used, and no
tactel is at fault.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from canopen.objectdictionary import ObjectDictionary

from skinbus.can.event import Event, EventKind
from skinbus.estimate import Plausibility, TactelFault
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects.cia import MAX_NODE_ID, EmcyCode
from skinbus.objects.profile import PATCH_FAULTY, PATCH_FAULTY_COUNT

LEAST_NS = 1_000_000_000
"""Between two EMCYs that name tactels of one patch: tactels that come and go do not fill the bus."""

REPEATS: Final = 5
"""Cycles in which a patch has repeated its readings, before it is reported: less may be a passing fault."""
REPEATS_NS: Final = 5_000_000_000
"""They come within so long of each other, and it is over after so long without one."""


class PlausibilityReport:
    """Publishes the judgement of the tactels of a bus.

    Data of the EMCY (0xFF00): node-ID, first tactel (from 1), its ``TactelFault`` bits, number of tactels.
    """

    def __init__(
        self, arm: Arm, bus: int, od: ObjectDictionary, device: Device, plausibility: Plausibility
    ) -> None:
        self._arm = arm
        self._device = device
        self._plausibility = plausibility
        self._patches = arm.patches_on(bus)
        self._rows = arm.node_id[self._patches] - 1
        self._map, self._count = (
            device.image_view(od[name.object].index, 1, MAX_NODE_ID)
            for name in (PATCH_FAULTY, PATCH_FAULTY_COUNT)
        )
        self._reported = np.zeros(arm.n_tactels, np.uint8)
        self._data: dict[int, bytes] = {}
        self._next_ns: dict[int, int] = {}
        self._n_last = 0
        self._repeats: dict[tuple[EventKind, int], tuple[int, int]] = {}
        """By kind and patch: how many cycles with such readings, and the time of the newest."""

    def show(self, now_ns: int) -> list[Event]:
        """Write the objects, raise and clear EMCYs; return the events."""
        events = self._note_repetitions(now_ns)
        n_faulty = self._plausibility.n_faulty[self._patches]
        total = int(n_faulty.sum())
        if total == 0 and self._n_last == 0:
            return events
        self._count[self._rows] = n_faulty
        n_reported = 0
        for p in range(self._patches.start, self._patches.stop):
            tactels = self._arm.tactels_of(p)
            faults = self._plausibility.faults[tactels]
            bits = np.flatnonzero(faults)
            node_id = int(self._arm.node_id[p])
            self._map[node_id - 1] = int(sum(1 << int(k) for k in bits))
            n_reported += len(bits)
            if np.array_equal(faults, self._reported[tactels]) or now_ns < self._next_ns.get(p, 0):
                n_reported += int(not np.array_equal(faults, self._reported[tactels]))
                continue
            self._reported[tactels] = faults
            self._next_ns[p] = now_ns + LEAST_NS
            if p in self._data:
                self._device.emcy_clear(EmcyCode.DEVICE_SPECIFIC, data=self._data.pop(p))
            if not len(bits):
                events.append(Event(t_ns=now_ns, kind=EventKind.TACTELS_IMPLAUSIBLE_END, node_id=node_id))
                continue
            self._data[p] = bytes([node_id, bits[0] + 1, faults[bits[0]], len(bits)])
            self._device.emcy(EmcyCode.DEVICE_SPECIFIC, data=self._data[p])
            detail = ", ".join(
                f"{k + 1} {TactelFault(int(faults[k])).name}".lower() for k in bits[:8].tolist()
            )
            if len(bits) > 8:
                detail += ", ..."
            events.append(
                Event(
                    t_ns=now_ns,
                    kind=EventKind.TACTELS_IMPLAUSIBLE,
                    node_id=node_id,
                    count=len(bits),
                    detail=detail,
                )
            )
        self._n_last = n_reported
        return events

    def _note_repetitions(self, now_ns: int) -> list[Event]:
        """Return the events of patches that have begun to repeat or copy readings, or have ceased to."""
        is_copied = self._plausibility.is_copied[self._patches]
        is_repeated = self._plausibility.is_repeated[self._patches]
        if not (self._repeats or is_repeated.any() or is_copied.any()):
            return []
        events = []
        for kind, found in (
            (EventKind.READINGS_REPEATED, is_repeated & ~is_copied),
            (EventKind.READINGS_COPIED, is_copied),
        ):
            for p in (np.flatnonzero(found) + self._patches.start).tolist():
                n, _ = self._repeats.get((kind, p), (0, 0))
                self._repeats[kind, p] = n + 1, now_ns
                if n + 1 == REPEATS:
                    events.append(self._event(now_ns, kind, p))
        for kind, p in [key for key, (_, last_ns) in self._repeats.items() if now_ns - last_ns > REPEATS_NS]:
            n, _ = self._repeats.pop((kind, p))
            if n >= REPEATS:
                events.append(self._event(now_ns, kind.end, p))
        return events

    def _event(self, now_ns: int, kind: EventKind, p: int) -> Event:
        return Event(t_ns=now_ns, kind=kind, node_id=int(self._arm.node_id[p]))
