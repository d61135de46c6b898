"""The master core: a CANopen node on each bus; runs SYNC, gathers readings, estimates, publishes contacts.

One cycle::

    SYNC ──► patches sample and send ──► all in, or deadline ──► estimate ──► contact TPDOs, summary TPDO

One cycle goes over all buses of the arm: the SYNC leaves on all of them at once, contacts are estimated from
the readings of all, and published on all.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skinbus.can.core import NEVER, Core, Output, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import CobIds, Frame, FrameBatch, Frames
from skinbus.config.system import ods_of
from skinbus.errors import BusError
from skinbus.estimate import DEFAULT_LEVEL, LEVELS, Clock, Estimator, Quality
from skinbus.master.bus_master import BusMaster
from skinbus.master.cycle import Cycle, CycleReport
from skinbus.master.freshness import GAP, Freshness
from skinbus.master.gather import Gather
from skinbus.master.guarding import Guarding
from skinbus.master.level_control import TPDO_BITS, CycleFlags, LevelControl
from skinbus.master.other_master import Contest
from skinbus.master.patches.provisioning import expected_nodes
from skinbus.master.patches.table import OPERATIONAL, Mask, PatchTable
from skinbus.master.publish import Publisher
from skinbus.model import Arm
from skinbus.model.validation import check_arm
from skinbus.node.device import Device
from skinbus.node.nmt import nmt_frame
from skinbus.node.sync import MAX_COUNTER
from skinbus.objects import cia
from skinbus.objects.profile import MASTER_NODE_ID
from skinbus.objects.readings import DEADLINE, ReadingsPlan

SETTLE_FRAMES = 8
"""Times of a frame from the first change on which a cycle is begun to its end: all TPDOs of two patches."""

STALE = 2
"""Periods after which readings are too old to be shown: the process was stopped in the middle of a cycle."""


class Master(Core):
    """A core: frames and time in, frames and events out.

    ``stopwatch`` measures the compute time that is published.
    ``clock`` measures the estimator within a cycle: it has ``budget_us``, or what the period leaves if
    that is less. Without a clock there is no limit.
    With ``follows`` it sends no SYNC and boots no patch: cycles begin with the SYNCs on the bus, and all
    readings in answer to them are taken as fresh, which a listener or a replay cannot verify.
    ``available`` is the highest level whose kernels are compiled, until ``allow`` raises it.
    With a ``number`` of 32 bits, another for each master, it gives way to a better claim of the bus.
    """

    def __init__(
        self,
        arm: Arm,
        *,
        level: str = DEFAULT_LEVEL,
        available: str | None = None,
        budget_us: float | None = None,
        clock: Clock | None = None,
        node_id: int = MASTER_NODE_ID,
        number: int | None = None,
        zero_at_start: bool = False,
        follows: bool = False,
        stopwatch: Callable[[], int] = lambda: 0,
        on_cycle: Callable[[CycleReport], None] = lambda report: None,
    ) -> None:
        check_arm(arm)
        if node_id in arm.node_id:
            raise ValueError(f"node-ID {node_id} of the master belongs to a patch of {arm.name}")
        if budget_us is not None and clock is None:
            raise ValueError("budget_us needs a clock to be measured by")
        self.arm = arm
        self.period_ns = round(1e9 / arm.bus.rate_hz)
        ods = ods_of(arm)
        plan = ReadingsPlan(arm, ods)
        self.table = PatchTable(arm.n_patches)
        self.freshness = Freshness(plan, self.period_ns, follows=follows, overflow=arm.bus.sync_counter)
        self.gather = Gather(plan, arm.n_tactels, self.freshness, 1_000_000 * arm.bus.max_age_ms)
        estimator = Estimator(arm, level=available or level, clock=clock)
        slowest = min(bus.bitrate for bus in arm.buses)
        self.level_control = LevelControl(
            self.period_ns, slowest, level, available, budget_us=budget_us, is_timed=clock is not None
        )
        self.cycle = Cycle(arm, plan, estimator, zero_at_start=zero_at_start)
        self.cycle.serials = self.table.serial
        stages = self.cycle.baseline, self.cycle.plausibility
        plans = expected_nodes(arm, ods)
        guards = arm.guard is not None and not follows
        self.branches = [
            BusMaster(
                *(arm, k, node_id, plans, self.table, *stages, data_ids),
                Guarding(self.cycle, arm.patches_on(k), ods, self.table) if guards else None,
                follows=follows,
            )
            for k, data_ids in enumerate(plan.cob_ids_on)
        ]
        """By bus."""
        self.n_buses = len(self.branches)
        self._follows = follows
        self._contest = None if number is None else Contest(node_id, number, len(arm.buses))
        devices = [branch.device for branch in self.branches]
        self.publisher = Publisher(arm, devices)
        self.robot = None
        if arm.robot:
            from skinbus.master.robot import MasterRobot  # nobody else pays for it

            self.robot = MasterRobot(arm, devices)
        self._stopwatch = stopwatch
        self._on_cycle = on_cycle
        self._compute_ns = 0
        self._counter = 0
        self._sync_ns = NEVER
        self._deadline = NEVER
        self._n_left_out = 0  # SYNCs, on purpose, since the newest
        self._is_free = plan.has_free and not plan.on_sync.any()
        """Whether all patches run freely: cycles begin with changes, too, and wait for more of them."""
        self._wait_ns = round(DEADLINE * self.period_ns)
        if self._is_free:
            self._wait_ns = round(1e9 * SETTLE_FRAMES * TPDO_BITS / slowest)
        self.device.on_sync = self._sync

    @property
    def device(self) -> Device:
        """The node on the first bus."""
        return self.branches[0].device

    @property
    def gave_way(self) -> BusError | None:
        """Why it is silent, when another master has the bus."""
        return self._contest.error if self._contest else None

    def cob_ids_on(self, bus: int) -> CobIds:
        """Identifiers the master listens to on a bus."""
        return self.branches[bus].cob_ids

    def data_ids_on(self, bus: int) -> CobIds:
        """Identifiers that carry readings on a bus."""
        return self.branches[bus].data_ids

    @property
    def n_owed(self) -> int:
        """Frames of readings that the open cycle waits for."""
        return self.gather.n_owed

    def take(self, now_ns: int, batch: FrameBatch) -> None:
        """Take frames of readings; ``step`` follows."""
        begin = self._stopwatch()
        self.gather.take(batch)
        self._compute_ns += self._stopwatch() - begin

    def bus_news(self, now_ns: int, event: Event) -> None:
        """Publish a fault of a bus; when none is left, what was seen before is no longer shown."""
        branch = self.branches[event.bus]
        was_lost = branch.is_lost
        branch.bus_news(now_ns, event)
        if event.kind is EventKind.FRAMES_DROPPED:
            self.gather.drop(event.count)
        elif branch.is_lost and not was_lost:
            self.gather.excuse(branch.patches)
            if all(other.is_lost for other in self.branches):
                self._forget_contacts()
        elif (was_lost and not branch.is_lost) or event.kind is EventKind.SEND_QUEUE_FULL_END:
            self.publisher.repeat(event.bus)
            self.freshness.bus_is_back(now_ns, branch.patches)

    def not_sent(self, now_ns: int, frames: Frames) -> None:
        """Have pending reports sent again, when its bus takes frames again."""
        for branch, own in zip(self.branches, self._by_bus(frames), strict=True):
            branch.not_sent(now_ns, own)
            if _has_sync(own) and not branch.is_lost:
                self.gather.excuse(branch.patches)
                self.freshness.sync_was_lost(now_ns, branch.patches)

    def allow(self, level: str) -> None:
        """Let a level be used as soon as there is time: its kernels are loaded. Any thread may call it."""
        self.cycle.estimator.allow(level)
        self.level_control.limit = LEVELS.index(level)

    def step(self, now_ns: int, frames: Frames) -> Step:
        """Take frames up to now; return frames to send, events, and the time of the next wake-up."""
        claims: list[Frame] = []
        if self._contest:
            if self._contest.error:
                return Step((), (), NEVER)
            claims = self._contest.step(now_ns, frames)
            if error := self._contest.error:
                news = Event(now_ns, EventKind.OTHER_MASTER, detail=str(error))
                return Step((), [news, Event(now_ns, EventKind.STOP)], NEVER)
            if not self._contest.has_begun:
                return Step(claims, (), self._contest.wake_ns)
        if self.branches[0].boots:
            self._begin_anew()
        frames_of = self._by_bus(frames)
        is_over = self.gather.is_open and (
            (self.gather.is_complete() and not self._is_free)
            or now_ns >= self._deadline
            or (self._follows and _has_sync(frames_of[0]))
        )
        for branch in self.branches:
            if branch.supervise(now_ns, frames_of[branch.number]):
                self.publisher.repeat(branch.number)  # clients may still hold what it published before
        self.freshness.started(now_ns, self.table)
        if is_over:
            self._close(now_ns)
        if self._is_free and self.gather.has_news and not self.gather.is_open:
            self._open(now_ns, self.table.is_running)
        sync: Frame | None = None
        for branch in self.branches:
            branch.answer(now_ns, frames_of[branch.number], sync)
            if branch.number == 0:
                sync = next((frame for frame in branch.out if frame.can_id == cia.SYNC_ID), None)
        out, events = self._taken()
        wake_ns = min(branch.wake_ns for branch in self.branches)
        if self.gather.is_open:  # the SYNC may just have opened it
            wake_ns = min(wake_ns, self._deadline)
        return Step(claims + out, events, wake_ns)

    def last_frames(self, now_ns: int) -> list[Frame]:
        """Return the last frames on all buses: contacts taken back, patches to pre-operational.

        None from a master that has sent nothing yet, or has given way: the patches are another's.
        """
        if self._contest and (self._contest.error or not self._contest.has_begun):
            return []
        self._forget_contacts()
        for branch in self.branches:
            self.publisher.repeat(branch.number)
            branch.out += branch.device.step(now_ns).frames
            branch.out.append(nmt_frame(cia.NmtCommand.PRE_OPERATIONAL, 0))
        return self._taken()[0]

    def _taken(self) -> Output:
        """Return the frames and events of all buses since the last call, with their numbers."""
        out: list[Frame] = []
        events: list[Event] = []
        for branch in self.branches:
            frames, found = branch.taken()
            out += frames
            events += found
        return out, events

    def _by_bus(self, frames: Frames) -> list[Frames]:
        return [[frame for frame in frames if frame.bus == k] for k in range(self.n_buses)]

    def _forget_contacts(self) -> None:
        """Take back all contacts; those seen later are new."""
        self.publisher.clear()
        if self.robot:
            self.robot.clear()
        self.cycle.tracker.reset()

    def _begin_anew(self) -> None:
        """Abandon the cycle under way: the node that produces the SYNC boots."""
        self._sync_ns = NEVER
        if self.gather.is_open:
            self.gather.close()
        self._forget_contacts()
        for branch in self.branches:
            self.publisher.repeat(branch.number)
            branch.wake_ns = 0

    def _sync(self, now_ns: int, counter: int) -> None:
        """Open the cycle of a SYNC that the own node has just produced."""
        if self._sync_ns != NEVER:
            self.level_control.sync(now_ns - self._sync_ns - self._n_left_out * self.period_ns)
        is_lost = np.array([branch.is_lost for branch in self.branches])[self.arm.patch_bus]
        is_running = self.table.is_running
        answering = np.asarray((is_running | self._follows) & ~is_lost)
        if self._follows:  # they may be started unseen, and are not behind then
            self.freshness.forget(~is_running)
        self._n_left_out = GAP - 1 if self.freshness.open(now_ns, answering, counter) else 0
        if self._n_left_out:
            self.device.skip_sync()
        # silent ones are waited for only when they have answered in full
        is_heard = (self.table.state == OPERATIONAL) | self.gather.has_answered
        self._open(now_ns, answering & is_running & is_heard, counter)

    def _open(self, now_ns: int, owing: Mask, counter: int = 0) -> None:
        """Open a cycle."""
        self._counter = counter or self._counter % MAX_COUNTER + 1  # a SYNC without counter is counted here
        self._sync_ns = now_ns
        self._deadline = now_ns + self._wait_ns
        self.gather.open(now_ns, owing)

    def _close(self, now_ns: int) -> None:
        """Close the cycle: estimate from what is fresh, publish, report."""
        clock, waited_ns = self._stopwatch, now_ns - self._sync_ns
        begin = clock()
        fresh = self._collect(now_ns)
        since = clock()
        budget_us = self.level_control.budget_us(waited_ns + since - begin)
        level, counts = self.level_control.level, self.gather.counts
        contacts, tracks = self.cycle.run(
            self._sync_ns, counts, fresh, level, budget_us, age_ns=self.gather.age_ns
        )
        estimated = clock()
        fresh &= ~self.cycle.plausibility.is_withheld
        self.table.last_fresh[fresh] = self._sync_ns
        ids = self.publisher.contacts(now_ns, contacts, tracks)
        on_robot = None
        if self.robot:
            on_robot = self.robot.close(self._sync_ns, contacts, tracks, is_blind=not fresh.any())
        self.publisher.loads(self.cycle.loads)
        self.publisher.frames(self.gather.counters)
        for branch in self.branches:
            self.publisher.patches(branch.number, now_ns, branch.table)
            branch.show(now_ns)
        end = clock()
        latency_ns = waited_ns + end - begin
        flags, said = self.level_control.close(
            since_sync_ns=latency_ns,
            estimate_ns=estimated - since,
            publishing_ns=end - estimated,
            budget_us=budget_us,
            is_cut_short=bool((contacts.quality & Quality.OVER_BUDGET).any()),
            n_contacts=len(contacts),
        )
        if said:
            self.branches[0].events.append(Event(now_ns, EventKind.LEVEL, detail=said))
        n_faulty = int(self.cycle.plausibility.n_faulty.sum())
        flags |= CycleFlags.INCOMPLETE * (not fresh.all())
        flags |= CycleFlags.OVERFLOW * (not ids.all())
        flags |= CycleFlags.IMPAIRED * (n_faulty > 0)
        report = CycleReport(
            t_ns=self._sync_ns,
            counter=self._counter,
            contacts=contacts,
            ids=ids,
            tracks=tracks,
            loads=self.cycle.loads,
            pressures=np.where(self.cycle.valid, self.cycle.pressures, 0.0),
            n_fresh=int(fresh.sum()),
            fresh=fresh,
            compute_ns=self._compute_ns + end - begin,
            latency_ns=latency_ns,
            level=level,
            flags=flags,
            budget_us=budget_us,
            robot=on_robot,
        )
        self._compute_ns = 0
        self.publisher.summary(report, self.level_control, n_faulty)
        self._on_cycle(report)

    def _collect(self, now_ns: int) -> Mask:
        """Return the patches (n_patches,) whose readings may be used."""
        # What a patch sends that is not known to be the right one, as it must be, makes no contacts.
        fresh = self.gather.close() & (self.table.is_running | self._follows)
        fresh &= now_ns - self._sync_ns <= STALE * self.period_ns
        for branch in self.branches:
            own = branch.patches
            fresh[own] &= ~branch.is_disturbed(self.freshness.started_ns[own])
            branch.readings(now_ns, self.gather, fresh[own])
        return fresh


def _has_sync(frames: Frames) -> bool:
    """Whether there is a SYNC among these frames."""
    return any(frame.can_id == cia.SYNC_ID for frame in frames)
