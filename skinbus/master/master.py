"""The master core: a CANopen node that runs SYNC, gathers readings, estimates and publishes contacts.

One cycle::

    SYNC ──► patches sample and send ──► all in, or deadline ──► estimate ──► contact TPDOs, summary TPDO
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from canopen.objectdictionary import ObjectDictionary

from skinbus.bus.core import NEVER, BusFault, Event, Step
from skinbus.bus.frame import Frame, FrameBatch
from skinbus.estimate import Baseline, Clock, Contacts, Estimator, Quality, Tracker, Tracks
from skinbus.master.alarms import BusAlarms, sound
from skinbus.master.boot import Identity
from skinbus.master.commands import Commands
from skinbus.master.cycle import Cycle
from skinbus.master.gather import Gather
from skinbus.master.network import Network
from skinbus.master.pace import CycleFlags, Pace
from skinbus.master.patches import PatchState, PatchTable
from skinbus.master.publish import Publisher
from skinbus.master.supervise import PatchPlan, Supervisor
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects import cia
from skinbus.objects.arm import ods_of
from skinbus.objects.dcf import configuration
from skinbus.objects.eds import load_eds
from skinbus.objects.profile import MAX_CONTACTS, current
from skinbus.objects.readings import ReadingsPlan

DEADLINE = 0.9
"""Share of the period after which a cycle closes with what it has: leaves a tenth to compute and publish."""

STALE = 2
"""Periods after which readings are too old to be shown: the process was stopped in the middle of a cycle."""

SILENT_ASKED_EVERY = 16
"""Cycles between two that wait for silent patches too: waiting costs latency, so few do; 0.3 s at 50 Hz."""

DEFAULT_NODE_ID = 127

BLIND_S = 1.0
"""Longest time that a contact may be without readings of its patch and come back as the same, s; ..."""
BLIND_CYCLES = 3
"""... at low rates at least so many cycles."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CycleReport:
    """What one cycle came to, for those who watch."""

    t_ns: int
    """Time of its SYNC."""
    counter: int
    contacts: Contacts
    ids: npt.NDArray[np.int64]
    """(n_contacts,) identity as published, 0 for a contact without a slot."""
    tracks: Tracks
    """The same contacts with identities over time, and those that are not seen in this cycle."""
    pressures: npt.NDArray[np.float64]
    n_fresh: int
    compute_ns: int
    """Gather + estimate + publish, by the stopwatch."""
    latency_ns: int
    """From SYNC until the contact TPDOs were handed to the bus, computing included."""
    level: str
    """The dearest level of this cycle; each contact says its own."""
    flags: CycleFlags


class Master:
    """A core (see ``bus.core``): frames and time in, frames and events out.

    ``stopwatch`` measures the compute time that is published; the core's own time is ``now_ns``.
    ``clock`` lets the estimator see, in the middle of a cycle, that its time runs out: then it has
    ``budget_us``, or what the period leaves if that is less. Without a clock it takes the time it takes.
    """

    def __init__(
        self,
        arm: Arm,
        *,
        level: str = "kmeans",
        budget_us: float | None = None,
        clock: Clock | None = None,
        node_id: int = DEFAULT_NODE_ID,
        zero_at_start: bool = False,
        stopwatch: Callable[[], int] = lambda: 0,
        on_cycle: Callable[[CycleReport], None] | None = None,
        on_compile: Callable[[], None] | None = None,
    ) -> None:
        if node_id in arm.patch_by_node:
            raise ValueError(f"node-ID {node_id} of the master belongs to a patch of {arm.name}")
        if budget_us is not None and clock is None:
            raise ValueError("budget_us needs a clock to be measured by")
        self.arm = arm
        self.period_ns = round(1e9 / arm.bus.rate_hz)
        ods = ods_of(arm)
        plan = ReadingsPlan(arm, ods)
        self.table = PatchTable(arm.n_patches)
        od = load_eds("skin-master", node_id)
        self.device = Device(od, node_id)
        self.gather = Gather(plan, arm.n_tactels)
        estimator = Estimator(arm, level=level, clock=clock, on_compile=on_compile)
        self.pace = Pace(
            self.period_ns, arm.bus.bitrate, level, budget_us=budget_us, is_timed=clock is not None
        )
        longest_s = max(BLIND_S, BLIND_CYCLES / arm.bus.rate_hz)
        tracker = Tracker(arm, n_slots=MAX_CONTACTS, blind_s=longest_s, on_compile=on_compile)
        baseline = Baseline(arm, on_compile=on_compile)
        self.cycle = Cycle(arm, plan, estimator, tracker, baseline, zero_at_start=zero_at_start)
        self.publisher = Publisher(arm, od, self.device)
        plans = [plan_of(node_id, od) for node_id, od in zip(arm.node_id.tolist(), ods, strict=True)]
        self.supervisor = Supervisor(plans, self.table)
        self.network = Network(self.device, plans)
        self.commands = Commands(arm, od, self.device, self.cycle.baseline)
        self.device.on_write = self._written
        self._data_ids = plan.cob_ids
        self._device_ids: frozenset[int] = frozenset()
        self._cob_ids: frozenset[int] = frozenset()
        self._stopwatch = stopwatch
        self._on_cycle = on_cycle
        self._compute_ns = 0
        self._counter = 0
        self._sync_ns = NEVER
        self._deadline = NEVER
        self._boots = True
        self._is_stopped = False
        self._bus_is_back = False
        self.bus_alarms = BusAlarms(self.device)
        self.device.on_sync = self._sync
        self.device.on_nmt = self._entered

    @property
    def cob_ids(self) -> frozenset[int]:
        """Identifiers the master listens to."""
        device = self.device.cob_ids
        if device is not self._device_ids:
            self._device_ids = device
            self._cob_ids = device | self.supervisor.cob_ids | self._data_ids
        return self._cob_ids

    @property
    def data_ids(self) -> frozenset[int]:
        """Identifiers that carry readings."""
        return self._data_ids

    @property
    def n_owed(self) -> int:
        """Frames of readings that the open cycle waits for."""
        return self.gather.n_owed

    def take(self, now_ns: int, batch: FrameBatch) -> None:
        """Take frames of readings; ``step`` follows."""
        begin = self._stopwatch()
        self.gather.take_batch(batch)
        self._compute_ns += self._stopwatch() - begin

    def bus_news(self, now_ns: int, event: Event) -> None:
        """Publish a fault of the bus; what was seen before it is no longer shown."""
        if event.kind is BusFault.OVERFLOW:
            self.gather.drop(event.count)
        elif event.kind in (BusFault.LOST, BusFault.BUS_OFF):
            self._forget_contacts()
            self.supervisor.bus_is_lost()
        elif event.kind in (BusFault.BACK, BusFault.BUS_OFF_END):
            self._bus_is_back = True
            self.supervisor.bus_is_back(now_ns)
            self.publisher.repeat()
        elif event.kind is BusFault.SEND_QUEUE_FULL_END:
            self.publisher.repeat()
        self.bus_alarms.take(event)

    def not_sent(self, now_ns: int, frames: Sequence[Frame]) -> None:
        """Have what must be told sent again, when the bus takes frames again."""
        self.device.not_sent(now_ns, frames)

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Take frames up to now; return frames to send, events, and the time of the next wake-up."""
        out: list[Frame] = []
        if self._boots:
            out += self._boot(now_ns)
        elif self._is_stopped:
            self.device.command(cia.NmtCommand.START)
        data = [frame for frame in frames if frame.can_id in self._data_ids]
        if data:
            begin = self._stopwatch()
            self.gather.take(data)
            self._compute_ns += self._stopwatch() - begin
            frames = [frame for frame in frames if frame.can_id not in self._data_ids]
        sent, events = self.supervisor.step(now_ns, frames)
        out += sent
        if self.gather.is_open and (self._is_complete() or now_ns >= self._deadline):
            events += self._close(now_ns)
        if events:
            sound(events, self.device)
        answer = self.device.step(now_ns, frames)
        out += answer.frames
        deadline = self._deadline if self.gather.is_open else NEVER
        wake = min(deadline, self.supervisor.wake_ns, answer.wake_ns)
        return Step(out, [*events, *answer.events], wake)

    def stop(self, now_ns: int) -> list[Frame]:
        """Return the frames that leave the bus in order: contacts taken back, patches to pre-operational."""
        self._forget_contacts()
        self.publisher.repeat()
        last = list(self.device.step(now_ns).frames)
        return [*last, Frame(cia.NMT_COMMAND_ID, bytes([cia.NmtCommand.PRE_OPERATIONAL, 0]))]

    def _forget_contacts(self) -> None:
        """Take back all contacts; those seen later are new."""
        self.publisher.clear()
        self.cycle.tracker.reset()

    def _boot(self, now_ns: int) -> list[Frame]:
        """Bring the own node up, and with it all patches through their boot-up."""
        self._sync_ns = NEVER
        if self.gather.is_open:  # reset in the middle of a cycle
            self.gather.close()
        self.cycle.tracker.reset()
        self.table.last_heard[:] = now_ns
        # The arm file says how often; what 0x1006 was before a reset is forgotten.
        self.device.set(cia.SYNC_PERIOD, 0, self.period_ns // 1000)
        frames = list(self.device.step(now_ns).frames)
        self.network.describe()
        self._boots = False  # not before: the boot itself passes through INITIALISING
        self.device.command(cia.NmtCommand.START)
        return frames + self.supervisor.start(now_ns)

    def _entered(self, state: cia.NmtState) -> None:
        """Note a reset of the own node: it boots again with the next step.

        An NMT master takes itself to OPERATIONAL (0x1F80, bit 2) and stays there, whoever commands otherwise.
        """
        self._boots |= state is cia.NmtState.INITIALISING
        self._is_stopped = state in (cia.NmtState.STOPPED, cia.NmtState.PRE_OPERATIONAL)

    def _written(self, index: int, sub: int, value: Any) -> cia.AbortCode | None:
        """Obey a write from the bus, or return why it is refused."""
        return self.network.refuse(index, sub, value) or self.commands.obey(index, sub, value)

    def _sync(self, now_ns: int, counter: int) -> None:
        """Open the cycle of a SYNC that the own node has just produced."""
        if self._sync_ns != NEVER:
            self.pace.sync(now_ns - self._sync_ns)
        self._counter = counter
        self._sync_ns = now_ns
        self._deadline = now_ns + round(DEADLINE * self.period_ns)
        self.gather.open(now_ns, self._owing())

    def _owing(self) -> npt.NDArray[np.bool_]:
        """Return the patches whose readings this cycle waits for.

        One that is silent is waited for when it has begun to send again, and now and then in any case:
        its frames may come after all others, when a cycle that did not wait has closed.
        """
        silent = self.table.state == PatchState.SILENT
        asked = (self.gather.seen != 0) | (self._counter % SILENT_ASKED_EVERY == 0) | self._bus_is_back
        return np.asarray((self.table.state == PatchState.OPERATIONAL) | (silent & asked))

    def _is_complete(self) -> bool:
        begin = self._stopwatch()
        complete = self.gather.is_complete()
        self._compute_ns += self._stopwatch() - begin
        return complete

    def _close(self, now_ns: int) -> list[Event]:
        """Close the cycle: estimate from what is fresh, publish, report."""
        begin = self._stopwatch()
        owing = self.gather.owing
        fresh = self.gather.close()
        if now_ns - self._sync_ns > STALE * self.period_ns:
            fresh[:] = False
        # A patch that is not believed in this cycle has not missed it.
        judged = owing & ~(self.gather.doubtful & (self.gather.seen == self.gather.plan.expected))
        events = self.supervisor.readings(now_ns, judged, fresh, self.gather.bad_length)
        if owing.any() and fresh[owing].all():
            self._bus_is_back = False
            self.bus_alarms.all_came()
        level, waited_ns = self.pace.level, now_ns - self._sync_ns
        since = self._stopwatch()
        budget_us = self.pace.budget_us(waited_ns + since - begin)
        contacts, tracks = self.cycle.run(self._sync_ns, self.gather.counts, fresh, level, budget_us)
        estimated = self._stopwatch()
        ids = self.publisher.contacts(now_ns, contacts, tracks)
        self.publisher.patches(now_ns, self.table, self.gather.counters)
        self.network.show(self.table)
        self.commands.show()
        end = self._stopwatch()
        compute_ns = self._compute_ns + end - begin
        latency_ns = waited_ns + end - begin
        self._compute_ns = 0
        flags, said = self.pace.close(
            since_sync_ns=latency_ns,
            estimate_ns=estimated - since,
            publishing_ns=end - estimated,
            budget_us=budget_us,
            is_cut_short=bool((contacts.quality & Quality.OVER_BUDGET).any()),
            n_contacts=len(tracks),
        )
        if said:
            events.append(Event(t_ns=now_ns, kind="level", detail=said))
        if (owing & ~fresh).any():
            flags |= CycleFlags.INCOMPLETE
        if not ids.all():
            flags |= CycleFlags.OVERFLOW
        n_fresh = int(fresh.sum())
        self.publisher.summary(
            counter=self._counter,
            n_contacts=len(contacts),
            alive=n_fresh,
            flags=flags,
            compute_us=compute_ns // 1000,
            latency_us=latency_ns // 1000,
            pace=self.pace,
            level=level,
            budget_us=budget_us,
        )
        if self._on_cycle:
            report = CycleReport(
                t_ns=self._sync_ns,
                counter=self._counter,
                contacts=contacts,
                ids=ids,
                tracks=tracks,
                pressures=np.where(fresh[self.arm.tactel_patch], self.cycle.pressures, 0.0),
                n_fresh=n_fresh,
                compute_ns=compute_ns,
                latency_ns=latency_ns,
                level=level,
                flags=flags,
            )
            self._on_cycle(report)
        return events


def plan_of(node_id: int, od: ObjectDictionary) -> PatchPlan:
    """Return what a patch must be and be told by its EDS; an identity left out or zero is not asked for."""
    return PatchPlan(
        node_id=node_id,
        identity=Identity(
            device_type=number_at(od, cia.DEVICE_TYPE),
            vendor=number_at(od, cia.IDENTITY, cia.IDENTITY_VENDOR),
            product=number_at(od, cia.IDENTITY, cia.IDENTITY_PRODUCT),
            revision=number_at(od, cia.IDENTITY, cia.IDENTITY_REVISION),
            serial=number_at(od, cia.IDENTITY, cia.IDENTITY_SERIAL),
        ),
        configuration=configuration(od),
        heartbeat_ns=number_at(od, cia.HEARTBEAT_PRODUCER) * 1_000_000,
    )


def number_at(od: ObjectDictionary, index: int, sub: int = 0) -> int:
    """Return the number that a dictionary holds by its file, 0 when it has none there."""
    variable = od.get_variable(index, sub)
    return 0 if variable is None else int(current(variable) or 0)
