"""Alarms: faults of patches and of the bus as EMCY of the master, raised and cleared with their causes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from skinbus.arrays import Bytes
from skinbus.can.core import NEVER
from skinbus.can.event import Event, EventKind
from skinbus.estimate import Plausibility, TactelFault
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects.cia import MAX_NODE_ID, EmcyCode
from skinbus.objects.profile import PATCH_FAULTY, PATCH_FAULTY_COUNT

RAISED_BY = {
    EventKind.HEARTBEAT_LOST: EmcyCode.HEARTBEAT,
    EventKind.PATCH_REBOOTED: EmcyCode.HEARTBEAT,
    EventKind.PATCH_FELL_BACK: EmcyCode.HEARTBEAT,
    EventKind.READINGS_LOST: EmcyCode.RPDO_TIMEOUT,
    EventKind.PATCH_REFUSED: EmcyCode.SOFTWARE_DATA_SET,
    EventKind.PATCH_DOUBLED: EmcyCode.COB_ID_COLLISION,
    EventKind.PATCH_EMCY: EmcyCode.HARDWARE,
    EventKind.OTHER_MASTER: EmcyCode.COMMUNICATION,
    EventKind.BABBLING: EmcyCode.COMMUNICATION,
    EventKind.ERROR_PASSIVE: EmcyCode.CAN_PASSIVE,
    EventKind.FRAMES_DROPPED: EmcyCode.CAN_OVERRUN,
    EventKind.CONTROLLER_OVERFLOW: EmcyCode.CAN_OVERRUN,
    EventKind.SEND_QUEUE_FULL_END: EmcyCode.CAN_OVERRUN,
    EventKind.BUS_OFF_END: EmcyCode.BUS_OFF_RECOVERED,
    EventKind.BUS_BACK: EmcyCode.BUS_OFF_RECOVERED,
}
"""Codes of CiA 301, table 26. A wrong device is a wrong data set: its configuration cannot be used. On a bus
that is lost nothing can be sent: its recovery is reported."""

CLEARED_BY = {
    EventKind.PATCH_STARTED: (
        *(EmcyCode.HEARTBEAT, EmcyCode.RPDO_TIMEOUT),
        *(EmcyCode.SOFTWARE_DATA_SET, EmcyCode.COB_ID_COLLISION),
    ),
    EventKind.PATCH_BACK: (EmcyCode.HEARTBEAT, EmcyCode.RPDO_TIMEOUT),
    EventKind.PATCH_EMCY_CLEARED: (EmcyCode.HARDWARE,),
    EventKind.OTHER_MASTER_END: (EmcyCode.COMMUNICATION,),
    EventKind.BABBLING_END: (EmcyCode.COMMUNICATION,),
    EventKind.ERROR_PASSIVE_END: (EmcyCode.CAN_PASSIVE,),
    EventKind.BUS_LOST: (EmcyCode.CAN_PASSIVE,),  # the counters begin anew with the interface
}
"""A patch that was started has booted anew; its own errors are read from it, and end when it reports so."""

PASSING = (EmcyCode.CAN_OVERRUN, EmcyCode.BUS_OFF_RECOVERED)
"""What is over in itself: it is cleared by a cycle in which all readings came."""

BURST = 4
"""EMCY of one cause that are sent at once: raised, cleared, raised and cleared."""

PAUSE_NS = 1_000_000_000
"""After these one in so long a time: a cause that comes and goes is reported, and does not fill the bus."""

Cause = tuple[EmcyCode, bytes]
"""Code and data of an EMCY."""


class Alarms:
    """EMCY of one node of the master, limited by cause.

    Data are the node-ID of a patch, the identifier of frames, or 0 for the bus itself.
    """

    def __init__(self, device: Device) -> None:
        self._device = device
        self._present: set[Cause] = set()
        self._full_at: dict[Cause, int] = {}
        """By cause the time at which a whole burst may be sent again (ns)."""
        self._waiting: dict[Cause, bool] = {}
        """Causes whose last change is not published yet, and whether they are present."""

    @property
    def wake_ns(self) -> int:
        """Time at which the next EMCY that waits may be sent (ns)."""
        return min(map(self._next_ns, self._waiting), default=NEVER)

    def reset(self) -> None:
        """Forget what was reported: the node was reset."""
        self._waiting.clear()
        self._present.clear()

    def step(self, now_ns: int, events: Iterable[Event]) -> None:
        """Raise and clear what events call for, as far as the limit allows."""
        for event in events:
            data = bytes([event.node_id]) if event.node_id else event.cob_id.to_bytes(4, "little")
            if (code := RAISED_BY.get(event.kind)) is not None:
                self._waiting[code, data] = True
            self._waiting |= dict.fromkeys([(code, data) for code in CLEARED_BY.get(event.kind, ())], False)
            if event.kind is EventKind.BUS_LOST:  # nothing is known of what was sent there
                self._clear(EmcyCode.COMMUNICATION)
            self._send(now_ns)
        self._send(now_ns)

    def all_came(self, now_ns: int) -> None:
        """Clear the faults that a cycle with all readings proves to be over."""
        self._clear(*PASSING)
        self._send(now_ns)

    def _clear(self, *codes: EmcyCode) -> None:
        self._waiting |= dict.fromkeys([cause for cause in self._present if cause[0] in codes], False)

    def _next_ns(self, cause: Cause) -> int:
        return self._full_at.get(cause, 0) - (BURST - 1) * PAUSE_NS

    def _send(self, now_ns: int) -> None:
        for cause in [cause for cause in self._waiting if self._next_ns(cause) <= now_ns]:
            is_present, device = self._waiting.pop(cause), self._device
            if device.emcy(cause[0], data=cause[1]) if is_present else device.emcy_clear(*cause):
                self._full_at[cause] = max(self._full_at.get(cause, 0), now_ns) + PAUSE_NS
                self._present ^= {cause}


LEAST_NS = 1_000_000_000
"""Between two EMCYs that name tactels of one patch: tactels that come and go do not fill the bus."""

REPEATS = 5
"""Cycles in which a patch has repeated its readings, before it is reported: less may be a passing fault."""
REPEATS_NS = 5_000_000_000
"""They come within so long of each other, and it is over after so long without one."""

NAMED = 8
"""Tactels that an event names at most."""


class PlausibilityReport:
    """Publishes the judgement of the tactels of a bus.

    Data of the EMCY (0xFF00): node-ID, first tactel (from 1), its ``TactelFault`` bits, number of tactels.
    """

    def __init__(self, arm: Arm, bus: int, device: Device, plausibility: Plausibility) -> None:
        self._device = device
        self._plausibility = plausibility
        self._patches = own = arm.patches_on(bus)
        self._node_ids = arm.node_id[own]
        self._tactels = [arm.tactels_of(p) for p in range(arm.n_patches)][own]
        self._map = device.view_of(PATCH_FAULTY, MAX_NODE_ID)
        self._count = device.view_of(PATCH_FAULTY_COUNT, MAX_NODE_ID)
        self._reported = np.zeros(arm.n_tactels, np.uint8)
        self._data: dict[int, bytes] = {}
        # by patch: when it may be reported again, cycles with repeated readings, time of the newest
        self._next_ns, self._n_repeats, self._repeated_ns = np.zeros((3, len(self._node_ids)), np.int64)

    def show(self, now_ns: int) -> list[Event]:
        """Write the objects, raise and clear EMCYs; return the events."""
        events = self._repetitions(now_ns)
        n_faulty = self._plausibility.n_faulty[self._patches]
        if not (n_faulty.any() or self._reported.any()):
            return events
        self._count[self._node_ids - 1] = n_faulty
        for p, (node_id, here) in enumerate(zip(self._node_ids.tolist(), self._tactels, strict=True)):
            faults = self._plausibility.faults[here]
            self._map[node_id - 1] = sum(1 << k for k in np.flatnonzero(faults).tolist())
            if now_ns >= self._next_ns[p] and not np.array_equal(faults, self._reported[here]):
                self._reported[here] = faults
                self._next_ns[p] = now_ns + LEAST_NS
                events.append(self._report(now_ns, node_id, faults))
        return events

    def _report(self, now_ns: int, node_id: int, faults: Bytes) -> Event:
        """Replace the EMCY of a patch; return the event."""
        if node_id in self._data:
            self._device.emcy_clear(EmcyCode.DEVICE_SPECIFIC, data=self._data.pop(node_id))
        bits = np.flatnonzero(faults).tolist()
        if not bits:
            return Event(now_ns, EventKind.TACTELS_IMPLAUSIBLE_END, node_id=node_id)
        self._data[node_id] = bytes([node_id, bits[0] + 1, faults[bits[0]], len(bits)])
        self._device.emcy(EmcyCode.DEVICE_SPECIFIC, data=self._data[node_id])
        names = [f"{k + 1} {TactelFault(int(faults[k])).name}".lower() for k in bits[:NAMED]]
        detail = ", ".join(names + ["..."] * (len(bits) > NAMED))
        return Event(now_ns, EventKind.TACTELS_IMPLAUSIBLE, node_id=node_id, count=len(bits), detail=detail)

    def _repetitions(self, now_ns: int) -> list[Event]:
        """Return the events of patches that have begun to repeat readings, or have ceased to."""
        found, n = self._plausibility.is_repeated[self._patches], self._n_repeats
        if not (found.any() or n.any()):
            return []
        n += found
        self._repeated_ns[found] = now_ns
        is_over = now_ns - self._repeated_ns > REPEATS_NS
        news = {
            EventKind.READINGS_REPEATED: found & (n == REPEATS),
            EventKind.READINGS_REPEATED_END: is_over & (n >= REPEATS),
        }
        n[is_over] = 0
        return [
            Event(now_ns, kind, node_id=node_id)
            for kind, those in news.items()
            for node_id in self._node_ids[those].tolist()
        ]
