"""Alarms: what happens to patches is EMCY of the master, raised when it comes and cleared when it goes."""

from __future__ import annotations

from collections.abc import Iterable

from skinbus.bus.core import Event
from skinbus.master.patches import PatchEvent
from skinbus.node.device import Device
from skinbus.objects.cia import EmcyCode

RAISED_BY = {
    PatchEvent.HEARTBEAT_LOST: EmcyCode.HEARTBEAT,
    PatchEvent.READINGS_LOST: EmcyCode.RPDO_TIMEOUT,
    PatchEvent.BAD_LENGTH: EmcyCode.PDO_LENGTH,
    PatchEvent.REFUSED: EmcyCode.SOFTWARE_DATA_SET,
    PatchEvent.EMCY: EmcyCode.HARDWARE,
}
"""Codes of CiA 301, table 26. A wrong device is a wrong data set: its configuration cannot be used."""

CLEARED_BY = {
    PatchEvent.STARTED: (
        EmcyCode.HEARTBEAT,
        EmcyCode.RPDO_TIMEOUT,
        EmcyCode.SOFTWARE_DATA_SET,
        EmcyCode.HARDWARE,
    ),
    PatchEvent.BACK: (EmcyCode.HEARTBEAT, EmcyCode.RPDO_TIMEOUT),
    PatchEvent.GOOD_LENGTH: (EmcyCode.PDO_LENGTH,),
    PatchEvent.EMCY_CLEARED: (EmcyCode.HARDWARE,),
}
"""A patch that was started has booted anew: what it complained of before is over."""


def sound(events: Iterable[Event], device: Device) -> None:
    """Raise and clear the EMCY that events of patches call for; byte 0 of its data is the patch's node-ID."""
    for event in events:
        node = bytes([event.node_id])
        if (code := RAISED_BY.get(event.kind)) is not None:  # type: ignore[call-overload]
            device.emcy(code, data=node)
        for code in CLEARED_BY.get(event.kind, ()):  # type: ignore[call-overload]
            device.emcy_clear(code, data=node)
