"""The network list of the master: the objects of CiA 302 for what it expects and what it finds.

The arm file is the source of all of it, so a client may read these objects but not write them: a write is
aborted with 0x08000021, local control; but for 0x1F82, see ``requests``. Nothing here makes the master act;
the supervisor does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from skinbus.arrays import Bytes
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import CobIds
from skinbus.estimate import Baseline
from skinbus.master.patches.provisioning import ExpectedNode
from skinbus.master.patches.supervisor import HEARTBEAT_FACTOR, PatchMonitor
from skinbus.master.patches.table import PatchState, PatchTable
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects import cia
from skinbus.objects.cia import MAX_NODE_ID, REQUEST_NMT, REQUEST_NMT_ALL, AbortCode, NmtCommand
from skinbus.objects.dcf import to_concise
from skinbus.objects.profile import COMMAND, PATCH_COMMAND, PATCH_SUSPECT, ZERO

IS_SLAVE = 1 << 0
BOOTED_BY_MASTER = 1 << 2
"""Bits of 0x1F81 (CiA 302-2): the node is in the network; it is configured and started when it boots."""

MISSING = 1
"""Value of 0x1F82 for a node that is not there; others are those of ``cia.NmtState``, 0 is not known."""

MAX_HEARTBEAT_MS = 0xFFFF

EXPECTED = (
    cia.EXPECTED_DEVICE_TYPE,
    cia.EXPECTED_VENDOR,
    cia.EXPECTED_PRODUCT,
    cia.EXPECTED_REVISION,
    cia.EXPECTED_SERIAL,
)
"""Objects of the identity of a patch, in the order of ``Identity``."""

FROM_ARM_FILE = frozenset(
    {
        *EXPECTED,
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
        cia.BOOT_TIME,
    }
)

COMMANDS = {
    **dict.fromkeys((0x06, 0x86), NmtCommand.RESET_NODE),
    **dict.fromkeys((0x07, 0x87), NmtCommand.RESET_COMMUNICATION),
}
"""Values of 0x1F82 that are obeyed; those with bit 7 leave the own node out of "all"."""


class Network:
    """Keeps those objects of a device in step with the plans and the table of patches; obeys clients.

    What a client writes to 0x1F82 is passed on to ``watch``; nothing is done before it is answered. "Command"
    and "Patch command" take what patches read now as their zeros.
    """

    def __init__(
        self,
        arm: Arm,
        bus: int,
        device: Device,
        plans: Sequence[ExpectedNode],
        taken: CobIds,
        watch: PatchMonitor,
        baseline: Baseline,
    ) -> None:
        """``taken``: identifiers of the patches, which no PDO of the own node may have."""
        self._arm, self._bus = arm, bus
        self._device, self._watch, self._baseline = device, watch, baseline
        self._taken = taken
        self._plans = tuple(plans)
        self._patches = {plan.node_id: p for p, plan in enumerate(plans)}
        self._rows = np.array([plan.node_id - 1 for plan in plans], np.intp)
        od = device.layout.od
        self._all, self._one = od[COMMAND].index, od[PATCH_COMMAND].index
        self._states: Bytes = device.image_view(REQUEST_NMT, 1, REQUEST_NMT_ALL)
        self._suspect = device.view_of(PATCH_SUSPECT, MAX_NODE_ID)
        self._own: NmtCommand | None = None
        self._zeroed: list[tuple[int, int]] = []

    def describe(self) -> None:
        """Write what is expected of every patch; needed after each reset of the own node.

        The values are put where clients read them, past the device's own heartbeat consumer: the supervisor
        is the one that watches.
        """
        for plan in self._plans:
            node_id, asked = plan.node_id, plan.configuration
            lost_after_ms = min(MAX_HEARTBEAT_MS, round(HEARTBEAT_FACTOR * plan.heartbeat_ns / 1e6))
            values: dict[int, Any] = {
                cia.HEARTBEAT_CONSUMER: node_id << 16 | lost_after_ms if lost_after_ms else 0,
                cia.EMCY_CONSUMER: cia.EMCY_BASE + node_id,
                cia.NMT_ASSIGNMENT: IS_SLAVE | BOOTED_BY_MASTER,
                cia.EXPECTED_DATE: asked.date,
                cia.EXPECTED_TIME: asked.time,
                **dict(zip(EXPECTED, plan.identity, strict=True)),
            }
            if asked.writes:
                values[cia.CONCISE_DCF] = to_concise(asked.writes)
            for index, value in values.items():
                self._device.values.put(index, node_id, value)

    def show(self, table: PatchTable) -> None:
        """Write the NMT state of every patch (0x1F82) as last received, and of the own node.

        And how many tactels of each patch have been touched ever since power came.
        """
        self._states[:] = 0  # what clients asked for
        self._states[self._rows] = np.where(table.state == PatchState.ABSENT.value, MISSING, table.nmt)
        self._states[self._device.node_id - 1] = self._device.nmt_state
        count = np.add.reduceat(self._baseline.suspect, self._arm.patch_start[:-1], dtype=np.int64)
        self._suspect[self._rows] = count[self._arm.patches_on(self._bus)]

    def obey(self, index: int, sub: int, value: Any) -> AbortCode | None:
        """Take a write from the bus; return why it is refused, None for other objects too."""
        if index in FROM_ARM_FILE:
            return AbortCode.LOCAL_CONTROL
        if index == REQUEST_NMT:
            command = COMMANDS.get(value)
            return AbortCode.LOCAL_CONTROL if command is None else self._request(sub, command, value)
        if index in (self._all, self._one):
            if value != ZERO:
                return AbortCode.NOT_STORED
            if index == self._one and sub not in self._patches:
                return AbortCode.LOCAL_CONTROL
            self.zero(sub if index == self._one else 0)
        is_cob_id = cia.TPDO_COMMUNICATION <= index < cia.TPDO_MAPPING and sub == cia.PDO_COB_ID
        if is_cob_id and not value & cia.COB_ID_INVALID and value & cia.COB_ID_MASK_11 in self._taken:
            return AbortCode.VALUE_INVALID
        return None

    def _request(self, sub: int, command: NmtCommand, value: int) -> AbortCode | None:
        """Have a node reset, or all of them."""
        if sub not in (*self._patches, self._device.node_id, REQUEST_NMT_ALL):
            return AbortCode.LOCAL_CONTROL
        refused = None
        if sub != self._device.node_id:
            refused = self._watch.request(self._patches.get(sub), command)
        if refused is None and sub not in self._patches and not (sub == REQUEST_NMT_ALL and value & 0x80):
            self._own = command
        return refused

    def command_own(self) -> None:
        """Command the own node, if that was asked for."""
        command, self._own = self._own, None
        if command is not None:
            self._device.command(command)

    def zero(self, node_id: int) -> None:
        """Take what a patch reads now as its zero, that of all patches with node-ID 0."""
        patch = self._arm.patch_at(node_id, self._bus) if node_id else None
        tactels = slice(None) if patch is None else self._arm.tactels_of(patch)
        self._zeroed.append((node_id, int(self._baseline.touched[tactels].sum())))
        self._baseline.zero(patch)

    def events(self, now_ns: int) -> list[Event]:
        """Return the events of the commands that were executed since the last call."""
        zeroed = self._zeroed
        self._zeroed = []
        return [
            Event(now_ns, EventKind.ZEROED, node_id=node_id, count=n, detail=f"{n} tactels were touched")
            for node_id, n in zeroed
        ]
