"""The master on one bus: its node there, the patches, and the faults of that bus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from skinbus.arrays import Ints
from skinbus.can.core import Output
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import CobIds, Frame, Frames
from skinbus.estimate import Baseline, Plausibility
from skinbus.master.alarms import Alarms, PlausibilityReport
from skinbus.master.commissioning.sessions import timeouts_of
from skinbus.master.gather import Gather
from skinbus.master.guarding import Guarding
from skinbus.master.network import Network
from skinbus.master.other_master import Contest, OtherMaster
from skinbus.master.patches.provisioning import ExpectedNode
from skinbus.master.patches.supervisor import PatchMonitor, Supervisor
from skinbus.master.patches.table import Mask, PatchTable
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects import cia
from skinbus.objects.published import master_od

LATE_PERIODS = 6.25
"""Between the stop and the boot of a patch: one that is late by four of them is silent for ``GAP`` then. Not
whole: after the end of a cycle its start would meet a SYNC, and might overtake it on the wire."""

UNHEARD = EventKind.BUS_BACK, EventKind.BUS_OFF_END, EventKind.FRAMES_DROPPED
"""Events after which somebody may have written to a patch without being heard."""


class BusMaster:
    """The master on one bus: a CANopen node there, NMT master of the patches there.

    The node of the first bus produces the SYNC; those of the others pass it on at once.
    """

    def __init__(
        self,
        arm: Arm,
        number: int,
        node_id: int,
        plans: Sequence[ExpectedNode],
        table: PatchTable,
        baseline: Baseline,
        plausibility: Plausibility,
        data_ids: CobIds,
        guarding: Guarding | None,
        *,
        follows: bool = False,
    ) -> None:
        """With ``follows`` another master produces the SYNC and boots the patches."""
        self.number = number
        self.patches = arm.patches_on(number)
        """Of all patches, those on the bus."""
        self.table = table = table.part(self.patches)
        plans = plans[self.patches]
        self.device = Device(master_od(node_id), node_id)
        self.supervisor: PatchMonitor = (
            PatchMonitor(plans, table) if follows else Supervisor(plans, table, timeouts_of(arm), guarding)
        )
        requests = {cia.SDO_CLIENT_BASE + plan.node_id for plan in plans}
        taken = data_ids | self.supervisor.cob_ids | requests
        self.network = Network(arm, number, self.device, plans, taken, self.supervisor, baseline)
        self.tactels = PlausibilityReport(arm, number, self.device, plausibility)
        self.alarms = Alarms(self.device)
        self.other_master = None if follows else OtherMaster()
        self._guarding = guarding
        self.is_lost = False
        """Whether nothing on the bus can be received."""
        self.out: list[Frame] = []
        self.events: list[Event] = []
        """What is to be sent and reported with this step."""
        self.wake_ns = 0
        """Time of the next thing to do (ns); earlier when frames arrive."""
        self.boots = True
        """Whether the node has been reset: it boots with the next step."""
        self.sync_counter = arm.bus.sync_counter
        """What 0x1019 becomes when the node boots."""
        self._period_us = round(1e9 / arm.bus.rate_hz) // 1000
        self._is_stopped = False
        self._is_first = True  # not booted yet
        self.data_ids = data_ids
        self._device_ids: CobIds = frozenset()
        self._cob_ids: CobIds = frozenset()
        self.device.on_write = self.network.obey
        self.device.on_nmt = self._entered

    @property
    def cob_ids(self) -> CobIds:
        """Identifiers that the master listens to on this bus, those of readings among them."""
        device = self.device.cob_ids
        if device is not self._device_ids:
            self._device_ids = device
            self._cob_ids = device | self.supervisor.cob_ids | self.data_ids | Contest.cob_ids
        return self._cob_ids

    @property
    def has_other_master(self) -> bool:
        """Whether another master sends SYNC."""
        return self.other_master is not None and self.other_master.is_present

    def is_disturbed(self, started_ns: Ints) -> Mask:
        """Return which patches may have answered a SYNC of another master: those started before it came."""
        if self.other_master is None or not self.other_master.is_present:
            return np.zeros(len(started_ns), np.bool_)
        return np.asarray(started_ns <= self.other_master.last_ns)

    def supervise(self, now_ns: int, frames: Frames) -> bool:
        """Boot if it is time, be operational, watch patches and other masters; return whether it booted."""
        has_booted = self.boots
        if has_booted:
            self._boot(now_ns)
        elif self._is_stopped:
            self.device.command(cia.NmtCommand.START)
        if has_booted and self.other_master:  # it is said again after a reset
            self.other_master.is_present = False
        self.events += self.other_master.step(now_ns, frames) if self.other_master else []
        self._take(self.supervisor.step(now_ns, frames))
        return has_booted

    def readings(self, now_ns: int, gather: Gather, fresh: Mask) -> None:
        """Note what came of the patches in the cycle of a SYNC.

        ``fresh`` (n_patches of the bus,): their readings are used. While there is another master that proves
        nothing, and that readings which were sent are not used is no fault of the patches.
        """
        owing = gather.owing[self.patches]
        if owing.any() and fresh[owing].all():
            self.alarms.all_came(now_ns)
        if self.has_other_master:
            owing = owing & (fresh | ~gather.has_sent[self.patches])
        self.events += self.supervisor.readings(now_ns, owing, fresh)
        doubled, late = gather.freshness.is_doubled[self.patches], gather.freshness.is_late[self.patches]
        if (doubled | late).any() and not self.has_other_master:
            until_ns = now_ns + round(1000 * LATE_PERIODS * self._period_us)
            self._take(self.supervisor.stop(now_ns, until_ns, doubled, late))

    def show(self, now_ns: int) -> None:
        """Write the states of patches and tactels to the objects."""
        self.network.show(self.table)
        self.events += self.tactels.show(now_ns)
        if self._guarding:
            self.events += self._guarding.show(now_ns, self.device)

    def answer(self, now_ns: int, frames: Frames, sync: Frame | None) -> None:
        """Publish events as EMCY and let the node answer frames; ``sync`` is one that it passes on."""
        self.alarms.step(now_ns, self.events)
        if sync is not None:
            self.out.append(sync)
            frames = [*frames, sync]
        step = self.device.step(now_ns, frames)
        self.network.command_own()
        self.out += step.frames
        self.events += [*step.events, *self.network.events(now_ns)]
        wake_ns = min(self.supervisor.wake_ns, step.wake_ns, self.alarms.wake_ns)
        self.wake_ns = now_ns if self.boots or self._is_stopped else max(wake_ns, now_ns)

    def taken(self) -> Output:
        """Return what is to be sent, and events, since the last call, with the number of the bus."""
        out, events, self.out, self.events = self.out, self.events, [], []
        if self.number:
            out = [frame._replace(bus=self.number) for frame in out]
            events = [replace(event, bus=self.number) for event in events]
        return out, events

    def _take(self, sent: Output) -> None:
        self.out += sent[0]
        self.events += sent[1]

    def bus_news(self, now_ns: int, event: Event) -> None:
        """Publish a fault of the bus; supervision is suspended while nothing can be received."""
        if event.kind in (EventKind.BUS_LOST, EventKind.BUS_OFF):
            self.is_lost = True
            self.supervisor.bus_is_lost()
        elif event.kind in (EventKind.BUS_BACK, EventKind.BUS_OFF_END):
            self.is_lost = False
            self.supervisor.bus_is_back(now_ns)
        elif event.kind is EventKind.SEND_QUEUE_FULL_END and not self.is_lost:
            self.supervisor.bus_is_back(now_ns)  # nothing could be asked, no SYNC came
        if event.kind in UNHEARD and self._guarding:
            self._guarding.forget()
        self.alarms.step(now_ns, [event])
        self.wake_ns = 0

    def not_sent(self, now_ns: int, frames: Frames) -> None:
        """Send EMCY messages and reports that were discarded again when the bus takes frames."""
        if frames:
            self.device.not_sent(now_ns, frames)
            self.wake_ns = 0

    def _boot(self, now_ns: int) -> None:
        """Bring the own node up, and with it all patches of the bus through their boot-up."""
        self.table.last_heard[:] = now_ns
        if self.number or not self.other_master:  # a consumer: bit 30 is not set
            self.device.set(cia.SYNC_COB_ID, 0, cia.SYNC_ID)
        self.device.set(cia.SYNC_COUNTER_OVERFLOW, 0, self.sync_counter)
        # The arm file says how often; not 0x1006 as it was before a reset.
        self.device.set(cia.SYNC_PERIOD, 0, self._period_us)
        self.out += self.device.step(now_ns).frames
        self.network.describe()
        self.alarms.reset()
        self.boots = False  # not before: the boot itself passes through INITIALISING
        self.device.command(cia.NmtCommand.START)
        self.out += self.supervisor.start(now_ns, is_first=self._is_first)
        self._is_first = False

    def _entered(self, state: cia.NmtState) -> None:
        """Note a reset of the own node: it boots again with the next step.

        An NMT master takes itself to OPERATIONAL (0x1F80, bit 2) and stays there, whoever commands otherwise.
        """
        self.boots |= state is cia.NmtState.INITIALISING
        self._is_stopped = state in (cia.NmtState.STOPPED, cia.NmtState.PRE_OPERATIONAL)
