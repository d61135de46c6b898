"""The network list of the master: the objects of CiA 302 for what it expects and what it finds.

The arm file is the source of all of it, so a client may read these objects but not write them: a write is
aborted with 0x08000021, local control; but for 0x1F82, see ``requests``. Nothing here makes the master act;
the supervisor does.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from canopen.objectdictionary import ObjectDictionary

from skinbus.can.core import NEVER
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.estimate import Baseline
from skinbus.master.patches.passive_monitor import PassiveMonitor
from skinbus.master.patches.provisioning import ExpectedNode
from skinbus.master.patches.supervisor import HEARTBEAT_FACTOR, RESETS, Supervisor
from skinbus.master.patches.table import PatchState, PatchTable
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects import cia
from skinbus.objects.cia import MAX_NODE_ID, REQUEST_NMT, REQUEST_NMT_ALL, AbortCode, NmtCommand
from skinbus.objects.dcf import to_concise
from skinbus.objects.profile import COMMAND, PATCH_COMMAND, PATCH_SUSPECT, ZERO, index_of

PatchMonitor = Supervisor | PassiveMonitor
"""The monitor of the patches on a bus, active or passive."""

IS_SLAVE: Final = 1 << 0
BOOTED_BY_MASTER: Final = 1 << 2
"""Bits of 0x1F81 (CiA 302-2): the node is in the network; it is configured and started when it boots."""

MISSING: Final = 1
"""Value of 0x1F82 for a node that is not there; others are those of ``cia.NmtState``, 0 is not known."""

MAX_HEARTBEAT_MS: Final = 0xFFFF

FROM_ARM_FILE: Final = frozenset(
    {
        cia.SYNC_COB_ID,
        cia.SYNC_PERIOD,
        cia.HEARTBEAT_CONSUMER,
        cia.EMCY_CONSUMER,
        cia.CONCISE_DCF,
        cia.CONFIGURE,
        cia.EXPECTED_DATE,
        cia.EXPECTED_TIME,
        cia.NMT_STARTUP,
        cia.NMT_ASSIGNMENT,
        cia.EXPECTED_DEVICE_TYPE,
        cia.EXPECTED_VENDOR,
        cia.EXPECTED_PRODUCT,
        cia.EXPECTED_REVISION,
        cia.EXPECTED_SERIAL,
        cia.BOOT_TIME,
    }
)


class Network:
    """Keeps those objects of a device in step with the plans and the table of patches."""

    def __init__(self, device: Device, plans: Sequence[ExpectedNode], taken: frozenset[int]) -> None:
        """``taken``: identifiers of the patches, which no PDO of the own node may have."""
        self._device = device
        self._taken = taken
        self._plans = tuple(plans)
        self._rows = np.array([plan.node_id - 1 for plan in plans], np.intp)
        self._states: npt.NDArray[np.uint8] = device.image_view(cia.REQUEST_NMT, 1, cia.REQUEST_NMT_ALL)

    def describe(self) -> None:
        """Write what is expected of every patch; needed after each reset of the own node.

        The values are put where clients read them, past the device's own heartbeat consumer: the supervisor
        is the one that watches.
        """
        put = self._device.values.put
        for plan in self._plans:
            node_id, identity = plan.node_id, plan.identity
            lost_after_ms = min(MAX_HEARTBEAT_MS, round(HEARTBEAT_FACTOR * plan.heartbeat_ns / 1e6))
            put(cia.HEARTBEAT_CONSUMER, node_id, node_id << 16 | lost_after_ms if lost_after_ms else 0)
            put(cia.EMCY_CONSUMER, node_id, cia.EMCY_BASE + node_id)
            put(cia.NMT_ASSIGNMENT, node_id, IS_SLAVE | BOOTED_BY_MASTER)
            put(cia.EXPECTED_DEVICE_TYPE, node_id, identity.device_type)
            put(cia.EXPECTED_VENDOR, node_id, identity.vendor)
            put(cia.EXPECTED_PRODUCT, node_id, identity.product)
            put(cia.EXPECTED_REVISION, node_id, identity.revision)
            put(cia.EXPECTED_SERIAL, node_id, identity.serial)
            put(cia.EXPECTED_DATE, node_id, plan.configuration.date)
            put(cia.EXPECTED_TIME, node_id, plan.configuration.time)
            if plan.configuration.writes:
                put(cia.CONCISE_DCF, node_id, to_concise(plan.configuration.writes))

    def show(self, table: PatchTable) -> None:
        """Write the NMT state of every patch (0x1F82) as last received, and of the own node."""
        self._states[:] = 0  # what clients asked for
        absent = table.state == PatchState.ABSENT
        self._states[self._rows] = np.where(absent, MISSING, table.nmt)
        self._states[self._device.node_id - 1] = self._device.nmt_state

    def refuse(self, index: int, sub: int, value: Any) -> cia.AbortCode | None:
        """Return why a write from the bus is refused; None for all objects that are not of the arm file."""
        if index in FROM_ARM_FILE:
            return cia.AbortCode.LOCAL_CONTROL
        is_cob_id = cia.TPDO_COMMUNICATION <= index < cia.TPDO_MAPPING and sub == cia.PDO_COB_ID
        if is_cob_id and not value & cia.COB_ID_INVALID and value & cia.COB_ID_MASK_11 in self._taken:
            return cia.AbortCode.VALUE_INVALID
        return None


COMMANDS: Final = {
    0x04: NmtCommand.STOP,
    0x05: NmtCommand.START,
    0x06: NmtCommand.RESET_NODE,
    0x07: NmtCommand.RESET_COMMUNICATION,
    0x7F: NmtCommand.PRE_OPERATIONAL,
}
"""Values of 0x1F82 as they are written."""
WITHOUT_MASTER: Final = {
    0x84: NmtCommand.STOP,
    0x85: NmtCommand.START,
    0x86: NmtCommand.RESET_NODE,
    0x87: NmtCommand.RESET_COMMUNICATION,
    0x8F: NmtCommand.PRE_OPERATIONAL,
}
"""The same, but the own node is left out of "all"."""


class Requests:
    """Passes what a client writes to 0x1F82 on to those who do it; nothing is done before it is answered."""

    def __init__(self, device: Device, plans: Sequence[ExpectedNode], watch: PatchMonitor) -> None:
        self._device = device
        self._watch = watch
        self._patches = {plan.node_id: p for p, plan in enumerate(plans)}
        self._own: NmtCommand | None = None

    def obey(self, index: int, sub: int, value: int) -> AbortCode | None:
        """Take a write from the bus; return why it is refused, None for other objects too."""
        if index != REQUEST_NMT:
            return None
        command = COMMANDS.get(value) or WITHOUT_MASTER.get(value)
        if command is None:
            return AbortCode.VALUE_INVALID
        if sub == REQUEST_NMT_ALL:
            refused = self._watch.request(None, command)
            if refused is None and command in RESETS and value in COMMANDS:
                self._own = command
            return refused
        if sub == self._device.node_id:
            # An NMT master is operational: nobody else would start the patches again.
            if command not in (*RESETS, NmtCommand.START):
                return AbortCode.DEVICE_STATE
            self._own = command
            return None
        p = self._patches.get(sub)
        return AbortCode.LOCAL_CONTROL if p is None else self._watch.request(p, command)

    def command_own(self) -> None:
        """Command the own node, if that was asked for."""
        command, self._own = self._own, None
        if command is not None:
            self._device.command(command)


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


TIME_OF_DAY: Final = struct.Struct("<IH")
"""Milliseconds since midnight, and days since 1 January 1984."""
EPOCH_DAYS: Final = 5113
"""Days from 1 January 1970 to 1 January 1984."""
DAY_MS: Final = 86_400_000
MAX_DAYS: Final = 0xFFFF


class TimeProducer:
    """Produces TIME on one bus; 0x1012 of the device says whether, 0x1013 has the microseconds of the last.

    ``period_s``  seconds between two TIME messages, 0 for none
    ``unix_ns``   returns the time of day, ns since 1970 (UTC); without it there is no TIME
    """

    def __init__(self, device: Device, period_s: float, unix_ns: Callable[[], int] | None) -> None:
        self._device = device
        self._period_ns = round(1e9 * period_s)
        self._unix_ns = unix_ns if period_s else None
        self.wake_ns = NEVER
        """Time of the next message, ns."""

    def boot(self, now_ns: int) -> None:
        """Begin: the first message follows with the next step."""
        produces = cia.COB_ID_PRODUCER if self._unix_ns else 0
        self._device.set(cia.TIME_COB_ID, 0, cia.TIME_ID | produces)
        self.wake_ns = now_ns if self._unix_ns else NEVER

    def step(self, now_ns: int) -> list[Frame]:
        """Return the message that is due, if any; missed ones are left out."""
        if now_ns < self.wake_ns or self._unix_ns is None:
            return []
        self.wake_ns = now_ns + self._period_ns
        unix_ns = self._unix_ns()
        self._device.set(cia.HIGH_RESOLUTION_TIME, 0, unix_ns // 1000 & 0xFFFFFFFF)
        days, ms = divmod(unix_ns // 1_000_000, DAY_MS)
        return [Frame(cia.TIME_ID, TIME_OF_DAY.pack(ms, min(max(days - EPOCH_DAYS, 0), MAX_DAYS)))]
