"""Alarms: faults of patches and of the bus as EMCY of the master, raised and cleared with their causes."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
from canopen.objectdictionary import ObjectDictionary

from skinbus.can.core import NEVER
from skinbus.can.event import Event, EventKind
from skinbus.estimate import Plausibility, TactelFault
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects.cia import MAX_NODE_ID, SYNC_ID, EmcyCode
from skinbus.objects.profile import PATCH_FAULTY, PATCH_FAULTY_COUNT

RAISED_BY = {
    EventKind.HEARTBEAT_LOST: EmcyCode.HEARTBEAT,
    EventKind.PATCH_REBOOTED: EmcyCode.HEARTBEAT,
    EventKind.PATCH_FELL_BACK: EmcyCode.HEARTBEAT,
    EventKind.READINGS_LOST: EmcyCode.RPDO_TIMEOUT,
    EventKind.PDO_LENGTH: EmcyCode.PDO_LENGTH,
    EventKind.PATCH_REFUSED: EmcyCode.SOFTWARE_DATA_SET,
    EventKind.PATCH_DOUBLED: EmcyCode.COB_ID_COLLISION,
    EventKind.PATCH_EMCY: EmcyCode.HARDWARE,
}
"""Codes of CiA 301, table 26. A wrong device is a wrong data set: its configuration cannot be used."""

_BY_BOOT = (
    EmcyCode.HEARTBEAT,
    EmcyCode.RPDO_TIMEOUT,
    EmcyCode.SOFTWARE_DATA_SET,
    EmcyCode.COB_ID_COLLISION,
)

CLEARED_BY = {
    EventKind.PATCH_STARTED: _BY_BOOT,
    EventKind.PATCH_BACK: (EmcyCode.HEARTBEAT, EmcyCode.RPDO_TIMEOUT),
    EventKind.PDO_LENGTH_END: (EmcyCode.PDO_LENGTH,),
    EventKind.PATCH_EMCY_CLEARED: (EmcyCode.HARDWARE,),
}
"""A patch that was started has booted anew; its own errors are read from it, and end when it reports so."""


BURST = 4
"""EMCY of one cause that are sent at once: raised, cleared, raised and cleared."""

PAUSE_NS = 1_000_000_000
"""After these one in so long a time: a cause that comes and goes is reported, and does not fill the bus."""


class PatchAlarms:
    """EMCY for events of patches, limited by cause; byte 0 of the data is the patch's node-ID."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._full_at: dict[tuple[EmcyCode, int], int] = {}
        """By cause the time at which a whole burst may be sent again (ns)."""
        self._waiting: dict[tuple[EmcyCode, int], bool] = {}
        """Causes whose last change is not published yet, and whether they are present."""

    @property
    def wake_ns(self) -> int:
        """Time at which the next EMCY that waits may be sent (ns)."""
        return min((self._next_ns(cause) for cause in self._waiting), default=NEVER)

    def clear(self) -> None:
        """Drop what waits, as when the node is reset."""
        self._waiting.clear()

    def step(self, now_ns: int, events: Iterable[Event]) -> None:
        """Raise and clear what events of patches call for, as far as the limit allows."""
        for event in events:
            if (code := RAISED_BY.get(event.kind)) is not None:
                self._waiting[code, event.node_id] = True
                self._send(now_ns)
            for code in CLEARED_BY.get(event.kind, ()):
                self._waiting[code, event.node_id] = False
                self._send(now_ns)
        if self._waiting:
            self._send(now_ns)

    def _next_ns(self, cause: tuple[EmcyCode, int]) -> int:
        return self._full_at.get(cause, 0) - (BURST - 1) * PAUSE_NS

    def _send(self, now_ns: int) -> None:
        for cause in [cause for cause in self._waiting if self._next_ns(cause) <= now_ns]:
            code, data = cause[0], bytes([cause[1]])
            is_present = self._waiting.pop(cause)
            if self._device.emcy(code, data=data) if is_present else self._device.emcy_clear(code, data):
                self._full_at[cause] = max(self._full_at.get(cause, 0), now_ns) + PAUSE_NS


BUS_RAISES = {
    EventKind.ERROR_PASSIVE: EmcyCode.CAN_PASSIVE,
    EventKind.FRAMES_DROPPED: EmcyCode.CAN_OVERRUN,
    EventKind.CONTROLLER_OVERFLOW: EmcyCode.CAN_OVERRUN,
    EventKind.SEND_QUEUE_FULL_END: EmcyCode.CAN_OVERRUN,
    EventKind.BUS_OFF_END: EmcyCode.BUS_OFF_RECOVERED,
    EventKind.BUS_BACK: EmcyCode.BUS_OFF_RECOVERED,
}
"""Codes of CiA 301, table 26. On a bus that is lost nothing can be sent: its recovery is reported."""

BUS_CLEARS = {
    EventKind.ERROR_PASSIVE_END: EmcyCode.CAN_PASSIVE,
    EventKind.BUS_LOST: EmcyCode.CAN_PASSIVE,  # the counters begin anew with the interface
}

BABBLER = struct.Struct("<IB")
"""Data of the EMCY for a babbling node: identifier, and hundreds of frames a second."""


SYNC_DATA = SYNC_ID.to_bytes(4, "little")


def report_other_bus(event: Event, device: Device) -> None:
    """Raise and clear the EMCY for a bus that the device is not on; its number, from 1, is in the data."""
    data = bytes([0, event.bus + 1])
    if event.kind in (EventKind.BUS_LOST, EventKind.BUS_OFF):
        device.emcy(EmcyCode.COMMUNICATION, data=data)
    elif event.kind in (EventKind.BUS_BACK, EventKind.BUS_OFF_END):
        device.emcy_clear(EmcyCode.COMMUNICATION, data=data)


class BusAlarms:
    """EMCY for faults of the bus; what is over in itself is cleared by a cycle in which all readings came."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._passing: set[EmcyCode] = set()
        self._babblers: dict[int, bytes] = {}

    def take(self, event: Event) -> None:
        """Raise or clear what an event calls for."""
        kind = event.kind
        if (code := BUS_RAISES.get(kind)) is not None:
            self._device.emcy(code)
            if code is not EmcyCode.CAN_PASSIVE:
                self._passing.add(code)
        if (code := BUS_CLEARS.get(kind)) is not None:
            self._device.emcy_clear(code)
        if kind is EventKind.BABBLING:
            self._babblers[event.cob_id] = BABBLER.pack(event.cob_id, min(event.count // 100, 0xFF))
            self._device.emcy(EmcyCode.COMMUNICATION, data=self._babblers[event.cob_id])
        elif kind is EventKind.BABBLING_END and event.cob_id in self._babblers:
            self._device.emcy_clear(EmcyCode.COMMUNICATION, data=self._babblers.pop(event.cob_id))
        elif kind is EventKind.BUS_LOST:
            for data in self._babblers.values():
                self._device.emcy_clear(EmcyCode.COMMUNICATION, data=data)
            self._babblers.clear()

    def other_master(self, events: Iterable[Event], *, is_present: bool) -> None:
        """Raise 0x8100 with the COB-ID of SYNC while another master is there; again after a reset."""
        if is_present:
            self._device.emcy(EmcyCode.COMMUNICATION, data=SYNC_DATA)
        elif any(event.kind == EventKind.OTHER_MASTER_END for event in events):
            self._device.emcy_clear(EmcyCode.COMMUNICATION, data=SYNC_DATA)

    def all_came(self) -> None:
        """Clear the faults that a cycle with all readings proves to be over."""
        for code in self._passing:
            self._device.emcy_clear(code)
        self._passing.clear()


LEAST_NS = 1_000_000_000
"""Between two EMCYs that name tactels of one patch: tactels that come and go do not fill the bus."""

REPEATS = 5
"""Cycles in which a patch has repeated its readings, before it is reported: less may be a passing fault."""
REPEATS_NS = 5_000_000_000
"""They come within so long of each other, and it is over after so long without one."""


class PlausibilityReport:
    """Publishes the judgement of the tactels of a bus.

    Data of the EMCY (0xFF00): node-ID, first tactel (from 1), its ``TactelFault`` bits, number of tactels.
    """

    def __init__(
        self, arm: Arm, bus: int, od: ObjectDictionary, device: Device, plausibility: Plausibility
    ) -> None:
        self._device = device
        self._plausibility = plausibility
        self._patches = arm.patches_on(bus)
        self._node_ids = arm.node_id[self._patches].tolist()
        self._tactels = [arm.tactels_of(p) for p in range(arm.n_patches)][self._patches]
        self._map, self._count = (
            device.image_view(od[name.object].index, 1, MAX_NODE_ID)
            for name in (PATCH_FAULTY, PATCH_FAULTY_COUNT)
        )
        self._reported = np.zeros(arm.n_tactels, np.uint8)
        self._data: dict[int, bytes] = {}
        self._next_ns = [0] * len(self._node_ids)
        # by patch: how many cycles with repeated readings, and the time of the newest
        self._n_repeats, self._repeated_ns = np.zeros((2, len(self._node_ids)), np.int64)

    def show(self, now_ns: int) -> list[Event]:
        """Write the objects, raise and clear EMCYs; return the events."""
        events = self._note_repetitions(now_ns)
        n_faulty = self._plausibility.n_faulty[self._patches]
        if not (n_faulty.any() or self._reported.any()):
            return events
        for p, node_id in enumerate(self._node_ids):
            faults = self._plausibility.faults[self._tactels[p]]
            self._count[node_id - 1] = n_faulty[p]
            self._map[node_id - 1] = sum(1 << k for k in np.flatnonzero(faults).tolist())
            is_new = not np.array_equal(faults, self._reported[self._tactels[p]])
            if is_new and now_ns >= self._next_ns[p]:
                self._reported[self._tactels[p]] = faults
                self._next_ns[p] = now_ns + LEAST_NS
                events.append(self._report(now_ns, node_id, faults))
        return events

    def _report(self, now_ns: int, node_id: int, faults: npt.NDArray[Any]) -> Event:
        """Replace the EMCY of a patch; return the event."""
        if node_id in self._data:
            self._device.emcy_clear(EmcyCode.DEVICE_SPECIFIC, data=self._data.pop(node_id))
        bits = np.flatnonzero(faults).tolist()
        if not bits:
            return Event(t_ns=now_ns, kind=EventKind.TACTELS_IMPLAUSIBLE_END, node_id=node_id)
        self._data[node_id] = bytes([node_id, bits[0] + 1, faults[bits[0]], len(bits)])
        self._device.emcy(EmcyCode.DEVICE_SPECIFIC, data=self._data[node_id])
        names = [f"{k + 1} {TactelFault(int(faults[k])).name}".lower() for k in bits[:8]]
        return Event(
            t_ns=now_ns,
            kind=EventKind.TACTELS_IMPLAUSIBLE,
            node_id=node_id,
            count=len(bits),
            detail=", ".join([*names, "..."] if len(bits) > 8 else names),
        )

    def _note_repetitions(self, now_ns: int) -> list[Event]:
        """Return the events of patches that have begun to repeat readings, or have ceased to."""
        found = self._plausibility.is_repeated[self._patches]
        n = self._n_repeats
        if not (found.any() or n.any()):
            return []
        n += found
        self._repeated_ns[found] = now_ns
        is_over = (n > 0) & (now_ns - self._repeated_ns > REPEATS_NS)
        kind, begun, ended = EventKind.READINGS_REPEATED, found & (n == REPEATS), is_over & (n >= REPEATS)
        n[is_over] = 0
        news = [(k, p) for k, those in ((kind, begun), (kind.end, ended)) for p in np.flatnonzero(those)]
        return [Event(t_ns=now_ns, kind=k, node_id=self._node_ids[p]) for k, p in news]
