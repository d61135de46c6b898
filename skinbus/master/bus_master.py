"""The master on one bus: its node there, the patches, and the faults of that bus."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.estimate import Baseline, Plausibility
from skinbus.master.alarms import BusAlarms, PatchAlarms, PlausibilityReport, report_other_bus
from skinbus.master.commissioning.sessions import timeouts_of
from skinbus.master.gather import Gather
from skinbus.master.network import Commands, Network, PatchMonitor, Requests, TimeProducer
from skinbus.master.other_master import OtherMaster
from skinbus.master.patches.passive_monitor import PassiveMonitor
from skinbus.master.patches.provisioning import ExpectedNode
from skinbus.master.patches.supervisor import Supervisor
from skinbus.master.patches.table import Mask, PatchTable
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects import cia
from skinbus.objects.eds import load_eds


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
        data_ids: frozenset[int],
        *,
        unix_ns: Callable[[], int] | None = None,
        follows: bool = False,
    ) -> None:
        """``unix_ns`` is the time of day for TIME.

        With ``follows`` another master produces the SYNC and boots the patches.
        """
        self.number = number
        self.patches = arm.patches_on(number)
        """Of all patches, those on the bus."""
        self.table = table = table.part(self.patches)
        plans = plans[self.patches]
        od = load_eds("skin-master", node_id)
        self.device = Device(od, node_id)
        self.supervisor: PatchMonitor = (
            PassiveMonitor([plan.node_id for plan in plans], table)
            if follows
            else Supervisor(plans, table, timeouts_of(arm))
        )
        requests = {cia.SDO_CLIENT_BASE + plan.node_id for plan in plans}
        self.network = Network(self.device, plans, data_ids | self.supervisor.cob_ids | requests)
        self.commands = Commands(arm, number, od, self.device, baseline)
        self.tactels = PlausibilityReport(arm, number, od, self.device, plausibility)
        self.requests = Requests(self.device, plans, self.supervisor)
        self.alarms = BusAlarms(self.device)
        self.patch_alarms = PatchAlarms(self.device)
        self.time = TimeProducer(self.device, arm.bus.time_stamp_s, None if follows else unix_ns)
        self.other_master = None if follows else OtherMaster()
        self.is_lost = False
        """Whether nothing on the bus can be received."""
        self.wake_ns = 0
        """Time of the next thing to do (ns); earlier when frames arrive."""
        self.boots = True
        """Whether the node has been reset: it boots with the next step."""
        self.sync_counter = arm.bus.sync_counter
        """What 0x1019 becomes when the node boots."""
        self._period_us = round(1e9 / arm.bus.rate_hz) // 1000
        self._is_stopped = False
        self._data_ids = data_ids
        self._device_ids: frozenset[int] = frozenset()
        self._cob_ids: frozenset[int] = frozenset()
        self.device.on_write = self._written
        self.device.on_nmt = self._entered

    @property
    def cob_ids(self) -> frozenset[int]:
        """Identifiers that the master listens to on this bus, those of readings among them."""
        device = self.device.cob_ids
        if device is not self._device_ids:
            self._device_ids = device
            self._cob_ids = device | self.supervisor.cob_ids | self._data_ids | {cia.SYNC_ID}
        return self._cob_ids

    def rests(self, now_ns: int) -> bool:
        """Return whether there is nothing to do until frames arrive."""
        return now_ns < self.wake_ns and not self.boots and not self._is_stopped

    def get_ready(self, now_ns: int) -> list[Frame]:
        """Boot if it is time, and be operational; return frames to send."""
        if self.boots:
            return self._boot(now_ns)
        if self._is_stopped:
            self.device.command(cia.NmtCommand.START)
        return []

    @property
    def has_other_master(self) -> bool:
        """Whether another master sends SYNC."""
        return self.other_master is not None and self.other_master.is_present

    def is_disturbed(self, started_ns: npt.NDArray[np.int64]) -> Mask:
        """Return which patches may have answered a SYNC of another master: those started before it came."""
        if self.other_master is None or not self.other_master.is_present:
            return np.zeros(len(started_ns), np.bool_)
        return np.asarray(started_ns <= self.other_master.last_ns)

    def supervise(self, now_ns: int, frames: Sequence[Frame]) -> tuple[list[Frame], list[Event]]:
        """Let frames reach those who watch the patches and other masters; return frames and events."""
        other_master = self.other_master.step(now_ns, frames) if self.other_master else []
        self.alarms.other_master(other_master, is_present=self.has_other_master)
        sent, events = self.supervisor.step(now_ns, frames)
        return self.on_bus(sent), [*other_master, *events]

    def readings(
        self, now_ns: int, gather: Gather, fresh: Mask, doubled: Mask
    ) -> tuple[list[Frame], list[Event]]:
        """Note what came of the patches in the cycle of a SYNC; return frames and events.

        ``fresh`` (n_patches of the bus,): their readings are used; ``doubled``: frames came that answer no
        SYNC. While there is another master that proves nothing, and that readings which were sent are not
        used is no fault of the patches.
        """
        owing = gather.owing[self.patches]
        if owing.any() and fresh[owing].all():
            self.alarms.all_came()
        if self.has_other_master:
            owing = owing & (fresh | ~gather.has_sent[self.patches])
        events = self.supervisor.readings(now_ns, owing, fresh, gather.bad_length[self.patches])
        if self.has_other_master or not doubled.any():
            return [], events
        sent, more = self.supervisor.doubled(now_ns, doubled)
        return self.on_bus(sent), events + more

    def show(self, now_ns: int) -> list[Event]:
        """Write the states of patches and tactels to the objects; return events."""
        self.network.show(self.table)
        self.commands.show()
        return self.tactels.show(now_ns)

    def drain(self, now_ns: int, stop: Mask, start: Mask) -> list[Frame]:
        """Stop patches (n_patches,) until nothing of theirs is under way, or start them; return frames."""
        if not (stop.any() or start.any()):
            return []
        return self.on_bus(self.supervisor.drain(now_ns, stop, start))

    def answer(
        self, now_ns: int, frames: Sequence[Frame], events: Sequence[Event], sync: Frame | None
    ) -> tuple[list[Frame], list[Event]]:
        """Publish events as EMCY and let the node answer frames; ``sync`` is one that it passes on."""
        passed_on = [] if sync is None else [sync]
        self.patch_alarms.step(now_ns, events)
        step = self.device.step(now_ns, [*frames, *passed_on] if passed_on else frames)
        self.requests.command_own()
        stamps = self.time.step(now_ns)
        wake_ns = min(self.supervisor.wake_ns, step.wake_ns, self.patch_alarms.wake_ns, self.time.wake_ns)
        self.wake_ns = max(wake_ns, now_ns)
        if self.boots or self._is_stopped:
            self.wake_ns = now_ns
        return [*passed_on, *step.frames, *stamps], [*step.events, *self.commands.events(now_ns)]

    def on_bus(self, frames: list[Frame]) -> list[Frame]:
        """Return own frames with the number of the bus."""
        return [frame._replace(bus=self.number) for frame in frames] if self.number else frames

    def numbered(self, events: list[Event]) -> list[Event]:
        """Return own events with the number of the bus."""
        return [replace(event, bus=self.number) for event in events] if self.number else events

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
        self.alarms.take(event)
        self.wake_ns = 0

    def other_bus_news(self, event: Event) -> None:
        """Report a fault of another bus of the arm."""
        report_other_bus(event, self.device)
        self.wake_ns = 0

    def not_sent(self, now_ns: int, frames: Sequence[Frame]) -> None:
        """Send EMCY messages and reports that were discarded again when the bus takes frames."""
        if frames:
            self.device.not_sent(now_ns, frames)
            self.wake_ns = 0

    def _boot(self, now_ns: int) -> list[Frame]:
        """Bring the own node up, and with it all patches of the bus through their boot-up."""
        self.table.last_heard[:] = now_ns
        if self.number or not self.other_master:  # a consumer: bit 30 is not set
            self.device.set(cia.SYNC_COB_ID, 0, cia.SYNC_ID)
        self.device.set(cia.SYNC_COUNTER_OVERFLOW, 0, self.sync_counter)
        # The arm file says how often; not 0x1006 as it was before a reset.
        self.device.set(cia.SYNC_PERIOD, 0, self._period_us)
        self.time.boot(now_ns)
        frames = list(self.device.step(now_ns).frames)
        self.network.describe()
        self.patch_alarms.clear()
        self.boots = False  # not before: the boot itself passes through INITIALISING
        self.device.command(cia.NmtCommand.START)
        return frames + self.supervisor.start(now_ns)

    def _written(self, index: int, sub: int, value: Any) -> cia.AbortCode | None:
        """Execute a write from the bus, or return why it is refused."""
        refused = self.network.refuse(index, sub, value) or self.commands.obey(index, sub, value)
        return refused or self.requests.obey(index, sub, value)

    def _entered(self, state: cia.NmtState) -> None:
        """Note a reset of the own node: it boots again with the next step.

        An NMT master takes itself to OPERATIONAL (0x1F80, bit 2) and stays there, whoever commands otherwise.
        """
        self.boots |= state is cia.NmtState.INITIALISING
        self._is_stopped = state in (cia.NmtState.STOPPED, cia.NmtState.PRE_OPERATIONAL)
