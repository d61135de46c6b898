"""The network list of the master: the objects of CiA 302 for what it expects and what it finds.

The arm file is the source of all of it, so a client may read these objects but not write them: a write is
aborted with 0x08000021, local control; but for 0x1F82, see ``requests``. Nothing here makes the master act;
the supervisor does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.master.patches.expected_nodes import ExpectedNode
from skinbus.master.patches.supervisor import HEARTBEAT_FACTOR
from skinbus.master.patches.table import PatchState, PatchTable
from skinbus.node.device import Device
from skinbus.objects import cia
from skinbus.objects.dcf import to_concise

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
