"""The skin as the master of another process or machine publishes it on the bus.

What its TPDOs carry: contacts rounded to 0.1 mm and 0.01 N, and a summary of each cycle with its level.
Covariances, quality and level of single contacts are read by SDO only, and are not known here; readings are
made into pressures on request.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from skinbus.bus.core_thread import CoreThread
from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.can.clock import Clock
from skinbus.can.core import Core, Step
from skinbus.can.frame import Frame, FrameBatch
from skinbus.config.system import load_arm, ods_of
from skinbus.errors import BusError
from skinbus.estimate import Baseline, Plausibility, TrackState
from skinbus.estimate.tracking import SPEED_MOVE
from skinbus.master.patches.table import MAX_MISSED, PatchState
from skinbus.model import Arm
from skinbus.node.sdo_client import SdoClient, SdoResult
from skinbus.objects import cia, profile
from skinbus.objects.contacts import ContactState
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import carries_readings, tpdos
from skinbus.objects.readings import N_IDS, ReadingsPlan
from skinbus.skin.addresses import BusAddress, find_places, shown
from skinbus.skin.bus_meter import BusMeter
from skinbus.skin.contact import CONTACT, UNKNOWN_LEVEL, Context, Records
from skinbus.skin.cycle import PATCH, Cycle, Readings, SkinLayout, fill_places
from skinbus.skin.feed import Positions, PushFeed
from skinbus.skin.listener import ContactRow, Listener, Summary
from skinbus.skin.opened import Channel, channel_words
from skinbus.skin.robot_here import RobotHere
from skinbus.skin.skin import Skin

MOVE_S: Final = 0.1
"""A contact moves when it went as far in this time as one that moves does: its TPDO does not say so. Over
less, the rounding to 0.1 mm would pass for motion."""

LOOK_NS: Final = 20_000_000
"""How often requests of the program are looked for."""

ZERO_S: Final = 3.0
"""Longest time that an answer of the master to a command is waited for."""


def listen(
    arm: str | Path | Arm,
    *,
    interface: str | None = None,
    channel: Channel = None,
    bitrate: int | None = None,
    node_id: int = profile.MASTER_NODE_ID,
    readings: bool = False,
) -> Skin:
    """Follow the contacts that a master of another process or machine publishes.

    It does not end by itself: without a master no cycle arrives, and ``latest().age_s`` grows.

    Args:
        arm: name or TOML file of the arm: names of links, places in space.
        interface: python-can's name; by default what the arm file says, else "socketcan".
        channel: of the interface, such as "can0"; of several buses a mapping from their names.
        bitrate: bit/s, where the interface sets it.
        node_id: of the master.
        readings: make pressures of what the patches send, with zeros found here: the master's are not known.

    Raises:
        ConfigError: the arm file has faults; FileNotFoundError too where there is none.
        AddressError: interface or channel fit no bus of the arm.
        BusError: a bus cannot be opened.
    """
    loaded = arm if isinstance(arm, Arm) else load_arm(arm, check_load=False)
    places = find_places(loaded.buses, interface, channel_words(channel), bitrate)
    return Skin(_ListeningFeed(loaded, places, node_id, readings))


@dataclass(frozen=True, slots=True)
class Request:
    """A zero that the program asks of the master: an SDO write, and where its result goes."""

    bus: int
    index: int
    sub: int
    result: Future[SdoResult]


class ListenCore(Core):
    """Receives a master and its patches; sends nothing but the zeros that a program asks for."""

    def __init__(
        self, arm: Arm, node_id: int, clock: Clock, feed: PushFeed, *, readings: bool = False
    ) -> None:
        self._arm = arm
        self._clock = clock
        self._feed = feed
        self._listener = listener = Listener(node_id)
        self._places: defaultdict[int, deque[tuple[int, float, float]]] = defaultdict(deque)
        self._seen_ns: dict[int, int] = {}
        self._open: Summary | None = None
        self._came: set[int] = set()
        """Slots of the open cycle."""
        self._live: set[int] = set()
        """Slots that hold a contact."""
        self._number = 0
        self._fresh_ns = np.zeros(arm.n_patches, np.int64)
        self._heard_ns = np.zeros(arm.n_patches, np.int64)
        self._emcy = np.zeros(arm.n_patches, np.uint32)
        self._silent_ns = (MAX_MISSED + 1) * round(1e9 / arm.bus.rate_hz)
        ods = ods_of(arm)
        plan = ReadingsPlan(arm, ods)
        self._data_ids = plan.cob_ids_on
        self.readings = ListenedReadings(arm, plan) if readings else None
        """What the patches send as pressures, where that was asked for."""
        self._heard = Readings.none(arm.n_tactels)
        self._meter = BusMeter(arm.buses)
        self.robot = RobotHere(arm)
        """Joint positions from the program and from drives."""
        self._sent_by = np.full((len(arm.buses), N_IDS), -1, np.int32)
        """Patch that sends an identifier, by bus."""
        for p, (od, bus, number) in enumerate(zip(ods, arm.patch_bus, arm.node_id, strict=True)):
            ids = [pdo.cob_id for pdo in tpdos(od) if carries_readings(pdo)]
            self._sent_by[bus, [*ids, cia.HEARTBEAT_BASE + number, cia.EMCY_BASE + number]] = p
        others = listener.cob_ids | {cia.SDO_SERVER_BASE + node_id}
        self._ids = [
            frozenset(np.flatnonzero(sent_by >= 0).tolist()) | others | self.robot.cob_ids_on(k)
            for k, sent_by in enumerate(self._sent_by)
        ]
        self.requests: deque[Request] = deque()
        """What the program asks for."""
        self._client = SdoClient(node_id)
        self._asked: Request | None = None

    @property
    def n_buses(self) -> int:
        """On how many buses the arm is."""
        return len(self._arm.buses)

    @property
    def cob_ids(self) -> frozenset[int]:
        """Identifiers received on the first bus."""
        return self._ids[0]

    def cob_ids_on(self, bus: int) -> frozenset[int]:
        """Identifiers received on a bus."""
        return self._ids[bus]

    def data_ids_on(self, bus: int) -> frozenset[int]:
        """Identifiers that carry readings."""
        return self._data_ids[bus]

    def take(self, now_ns: int, batch: FrameBatch) -> None:
        """Note which patches send readings, and what."""
        self._meter.take_batch(batch)
        if self.readings:
            self.readings.take(batch)
        frames = batch.frames[: batch.n]
        patches = self._sent_by[frames["bus"], frames["can_id"]]
        self._fresh_ns[patches[patches >= 0]] = now_ns

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Take frames; return requests to the master."""
        self.robot.take(frames)
        for frame in frames:
            self._meter.take(frame)
            p = self._sent_by[frame.bus, frame.can_id] if frame.can_id < N_IDS else -1
            if p >= 0:
                self._heard_ns[p] = now_ns
                if frame.can_id < cia.HEARTBEAT_BASE and len(frame.data) >= 2:
                    self._emcy[p] = int.from_bytes(frame.data[:2], "little")
            elif frame.bus == 0:  # contacts are published on all buses alike
                self._take(now_ns, frame)
        return Step(self._request(now_ns, frames), (), now_ns + LOOK_NS)

    def _take(self, now_ns: int, frame: Frame) -> None:
        """Take a frame of the master; a summary begins a cycle, its contacts follow."""
        listener = self._listener
        n_before = listener.n_summaries
        listener.step(now_ns, (frame,))
        if listener.n_summaries > n_before:
            self._end_cycle()
            self._open = listener.summary
            if self.readings:
                self._heard = self.readings.end_cycle(now_ns)
        elif self._open is not None and (slot := listener.slot_of.get(frame.can_id)) is not None:
            row = listener.row(slot)
            if row is not None and row.t_ns == now_ns:
                self._came.add(slot)
        if self._open is not None and self._is_complete(self._open):
            self._end_cycle()

    def _rows(self, slots: set[int]) -> list[ContactRow]:
        """Return what was last said of the contacts in slots."""
        return [row for slot in sorted(slots) if (row := self._listener.row(slot))]

    def _is_complete(self, summary: Summary) -> bool:
        """Whether all contacts of the open cycle have come: those seen, and the end of those before it."""
        n_seen = sum(row.state in (ContactState.TOUCH, ContactState.HELD) for row in self._rows(self._came))
        return self._live <= self._came and n_seen == min(summary.n_contacts, profile.MAX_CONTACTS)

    def _end_cycle(self) -> None:
        """Hand the open cycle on; it is not complete where a frame was lost."""
        summary, self._open = self._open, None
        if summary is None:
            return
        self._number += 1
        # One whose frame was lost is there until a frame says otherwise.
        rows, self._came = self._rows(self._live | self._came), set()
        self._live = {row.slot for row in rows if row.state not in (ContactState.LIFT, ContactState.NONE)}
        latency_ns = 1000 * summary.latency_us
        sync_ns = summary.t_ns - latency_ns
        contacts = self._records([row for row in rows if row.state is not ContactState.NONE], sync_ns)
        placed = self.robot.place(sync_ns, contacts)
        cycle = Cycle(
            self._number,
            sync_ns,
            summary.counter,
            summary.level,
            summary.flags,
            1e-9 * latency_ns,
            Context(self._feed.layout, self._clock.now_ns, lambda: placed),
            contacts,
            self._patches(summary.t_ns),
            self._heard,
            bus_loads=self._meter.loads(summary.t_ns),
        )
        self._feed.push(cycle)

    def _records(self, rows: Sequence[ContactRow], sync_ns: int) -> Records:
        records = np.zeros(len(rows), CONTACT)
        for record, row in zip(records, rows, strict=True):
            state = TrackState(row.state)
            if state is TrackState.HELD and self._moves(row):
                state = TrackState.MOVE
            if state not in (TrackState.COAST, TrackState.LIFT):
                self._seen_ns[row.slot] = sync_ns
            for name in ("id", "link", "s", "a", "force"):
                record[name] = getattr(row, name)
            record["state"], record["seen_ns"] = state, self._seen_ns.get(row.slot, sync_ns)
            record["level"] = UNKNOWN_LEVEL
        fill_places(records, self._arm)
        return records

    def _moves(self, row: ContactRow) -> bool:
        """Whether a contact has gone so far of late as one that moves."""
        places = self._places[row.slot]
        if row.state is ContactState.TOUCH:
            places.clear()
        places.append((row.t_ns, row.s, row.a))
        while places[-1][0] - places[0][0] > MOVE_S * 1e9:
            places.popleft()
        if row.link >= len(self._arm.links):
            return False
        _, s, a = places[0]
        surface = self._arm.links[row.link].surface
        return float(surface.distance(s, a, row.s, row.a)) > SPEED_MOVE * MOVE_S

    def _patches(self, now_ns: int) -> Records:
        """Return the states of patches by what was received from them."""
        records = np.zeros(len(self._fresh_ns), PATCH)
        is_sending = (self._fresh_ns > 0) & (now_ns - self._fresh_ns <= self._silent_ns)
        records["state"] = np.select(
            [is_sending, self._fresh_ns > 0, self._heard_ns > 0],
            [PatchState.OPERATIONAL, PatchState.SILENT, PatchState.BOOTING],
            PatchState.ABSENT,
        )
        records["last_fresh_ns"], records["emcy"] = self._fresh_ns, self._emcy
        return records

    def _request(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        """Return what goes on of the transfers that the program asked for, one at a time."""
        if self._asked is None and self.requests:
            self._asked = self.requests.popleft()
            self._client.start_write(self._asked.index, self._asked.sub, profile.ZERO.to_bytes(4, "little"))
        asked = self._asked
        if asked is None:
            return []
        out = self._client.step(now_ns, [frame for frame in frames if frame.bus == asked.bus])
        if self._client.result is not None:
            asked.result.set_result(self._client.result)
            self._asked = None
        return [frame._replace(bus=asked.bus) for frame in out]


class ListenedReadings:
    """Readings between the summaries of a master as pressures, calibrated and judged as by that master.

    The zeros of the master are not on the bus. Those here are found in the same way from the same readings,
    but since the listener began: until half a second has passed untouched, pressures count from the
    calibration.
    """

    def __init__(self, arm: Arm, plan: ReadingsPlan) -> None:
        self._arm = arm
        self._plan = plan
        self._counts = np.zeros(arm.n_tactels, np.int32)
        self._seen = np.zeros(arm.n_patches, np.int32)
        self._scale = plan.counts_scale * arm.tactel_gain
        self._baseline = Baseline(arm)
        self._plausibility = Plausibility(arm)
        self._wanted: deque[int | None] = deque()

    def take(self, batch: FrameBatch) -> None:
        """Take data frames."""
        self._plan.unpack(batch, self._counts, self._seen)

    def end_cycle(self, t_ns: int) -> Readings:
        """Return the readings since the last cycle; a patch of which a frame is missing has none."""
        fresh = (self._seen == self._plan.expected) & (self._plan.expected != 0)
        self._seen[:] = 0
        pressures = (self._counts - self._plan.counts_offset) * self._scale
        self._plausibility.judge(pressures, t_ns, fresh, self._baseline)
        self._baseline.apply(pressures, t_ns, fresh)
        while self._wanted:
            self._baseline.zero(self._wanted.popleft())
        return Readings.of(self._arm, pressures, fresh, self._plausibility.faults)

    def zero(self, patch: int | None) -> None:
        """Take what is read in the next cycle for zero, on one patch or all; from any thread."""
        self._wanted.append(patch)


class _ListeningFeed(PushFeed):
    """The cycles that a thread receives from the bus."""

    def __init__(self, arm: Arm, places: Sequence[BusAddress], node_id: int, readings: bool) -> None:
        super().__init__(SkinLayout.of(arm), f"listening on {shown(places)}")
        self._arm = arm
        self._clock = MonotonicClock()
        self._od = load_eds("skin-master", node_id)
        self._core = ListenCore(arm, node_id, self._clock, self, readings=readings)
        self._thread = CoreThread(self._core, *(place.open for place in places), on_end=self.end)
        self._thread.start()

    def zero(self, patch: int | None) -> None:
        """Have the master take new zeros; SdoAborted when it refuses."""
        arm, result = self._arm, Future[SdoResult]()
        bus, number, name = 0, 0, profile.COMMAND
        if patch is not None:
            bus, number, name = int(arm.patch_bus[patch]), int(arm.node_id[patch]), profile.PATCH_COMMAND
        self._core.requests.append(Request(bus, profile.index_of(self._od, name)[0], number, result))
        try:
            result.result(ZERO_S).unwrap()
        except TimeoutError:
            raise BusError("the master has not answered") from None
        if self._core.readings:
            self._core.readings.zero(patch)

    def set_joints(self, positions: Positions, t_ns: int | None) -> None:
        """Take joint positions of the program."""
        self._core.robot.offer(self._clock.now_ns() if t_ns is None else t_ns, positions)

    def close(self) -> None:
        """End the thread."""
        self._thread.stop()
