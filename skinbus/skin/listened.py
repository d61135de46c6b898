"""The skin as the master of another process or machine publishes it on the bus.

What its TPDOs carry: contacts rounded to 0.1 mm and 0.01 N, and a summary of each cycle with its level.
Covariances, quality and level of single contacts are read by SDO only, and are not known here; readings are
made into pressures on request.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping, Sequence
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
from skinbus.estimate import TrackState
from skinbus.estimate.tracking import SPEED_MOVE
from skinbus.master.patches.table import MAX_MISSED, PatchState
from skinbus.model import Arm
from skinbus.node.sdo_client import SdoClient, SdoResult
from skinbus.objects import cia, profile
from skinbus.objects.contacts import ContactState
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import carries_readings, tpdos
from skinbus.objects.readings import N_IDS, ReadingsPlan
from skinbus.skin.addresses import find_places
from skinbus.skin.bus_meter import BusMeter
from skinbus.skin.cycle import (
    CONTACT,
    PATCH,
    UNKNOWN_LEVEL,
    Now,
    Readings,
    Records,
    SkinLayout,
    fill_places,
)
from skinbus.skin.feed import Positions, PushFeed
from skinbus.skin.listened_readings import ListenedReadings
from skinbus.skin.listener import ContactRow, Listener, Summary
from skinbus.skin.opened import channel_words
from skinbus.skin.robot_here import ReadCycle, offer_joints, robot_here
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
    channel: str | Mapping[str, str] | None = None,
    bitrate: int | None = None,
    node_id: int = profile.MASTER_NODE_ID,
    readings: bool = False,
) -> Skin:
    """Follow the contacts that a master of another process or machine publishes.

    arm:       name or TOML file of the arm: names of links, places in space
    interface: python-can's name; by default what the arm file says, else "socketcan"
    channel:   of the interface, such as "can0"; of several buses a mapping from their names
    bitrate:   bit/s, where the interface sets it
    node_id:   of the master
    readings:  make pressures of what the patches send, with zeros found here, as the master's are not known

    It does not end by itself: without a master no cycle arrives, and ``latest().age_s`` grows.

    Raises:
        ConfigError: the arm file has faults.
        AddressError: interface or channel fit no bus of the arm.
        BusError: a bus cannot be opened.
    """
    loaded = arm if isinstance(arm, Arm) else load_arm(arm, check_load=False)
    return listen_on(loaded, interface, channel_words(channel), bitrate, node_id=node_id, readings=readings)


def listen_on(
    arm: Arm,
    interface: str | None,
    channels: Sequence[str],
    bitrate: int | None,
    *,
    node_id: int = profile.MASTER_NODE_ID,
    readings: bool = False,
) -> Skin:
    """Do the same with channels as the command line has them."""
    places = find_places(arm.buses, interface, channels, bitrate)
    feed = _ListeningFeed(arm, node_id, readings)
    feed.run_on(CoreThread(feed.core, *(place.open for place in places), on_end=feed.end))
    return Skin(feed)


class ListenedCycle(ReadCycle):
    """A cycle as it was published."""

    def __init__(
        self,
        number: int,
        summary: Summary,
        layout: SkinLayout,
        clock: Clock,
        contacts: Records,
        patches: Records,
        readings: Readings | None = None,
    ) -> None:
        latency_ns = 1000 * summary.latency_us
        super().__init__(
            number,
            summary.t_ns - latency_ns,
            summary.counter,
            summary.level,
            summary.flags,
            1e-9 * latency_ns,
            layout,
            Now(clock, summary.t_ns),
        )
        self._contacts, self._patches = contacts, patches
        if readings is not None:
            self.readings = readings

    @property
    def records(self) -> Records:
        """The contacts as records."""
        return self._contacts

    @property
    def patch_records(self) -> Records:
        """The patches as records."""
        return self._patches


class ListenCore(Core):
    """Receives a master and its patches; sends nothing but the zeros that a program asks for."""

    def __init__(
        self, arm: Arm, node_id: int, clock: Clock, feed: PushFeed, *, readings: bool = False
    ) -> None:
        self._arm = arm
        self._clock = clock
        self._feed = feed
        self._listener = Listener(node_id)
        self._contacts: dict[int, ContactRow] = {}
        self._places: dict[int, deque[tuple[int, float, float]]] = {}
        self._seen_ns: dict[int, int] = {}
        self._open: Summary | None = None
        self._came: set[int] = set()
        self._live: set[int] = set()
        self._number = 0
        n = arm.n_patches
        self._fresh_ns = np.zeros(n, np.int64)
        self._heard_ns = np.zeros(n, np.int64)
        self._emcy = np.zeros(n, np.uint32)
        self._silent_ns = (MAX_MISSED + 1) * round(1e9 / arm.bus.rate_hz)
        ods = ods_of(arm)
        plan = ReadingsPlan(arm, ods)
        self._data_ids = plan.cob_ids_on
        self.readings = ListenedReadings(arm, plan) if readings else None
        """What the patches send as pressures, where that was asked for."""
        self._heard: Readings | None = None
        self._meter = BusMeter(arm.buses)
        self._patch_of = np.full((len(arm.buses), N_IDS), -1, np.int32)
        for p, od in enumerate(ods):
            ids = [pdo.cob_id for pdo in tpdos(od) if carries_readings(pdo)]
            self._patch_of[arm.patch_bus[p], ids] = p
        self._patch_by_id: list[dict[int, int]] = [{} for _ in arm.buses]
        for p, number in enumerate(arm.node_id.tolist()):
            patch_by_id = self._patch_by_id[int(arm.patch_bus[p])]
            patch_by_id[cia.HEARTBEAT_BASE + number] = patch_by_id[cia.EMCY_BASE + number] = p
        self.robot = robot_here(arm)
        """Joint positions from the program and from drives; None without ``[robot]``."""
        self._ids = [
            frozenset(patch_by_id)
            | self._listener.cob_ids
            | self._data_ids[k]
            | {cia.SDO_SERVER_BASE + node_id, cia.SYNC_ID}
            | (self.robot.cob_ids_on(k) if self.robot else set())
            for k, patch_by_id in enumerate(self._patch_by_id)
        ]
        self.requests: deque[tuple[int, int, int, Answer]] = deque()
        """Commands of the program: bus, index, sub-index, where the answer goes."""
        self._clients = [SdoClient(node_id) for _ in arm.buses]
        self._asked: list[Answer | None] = [None] * len(arm.buses)

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
        self._meter.take_batch(batch, now_ns)
        if self.readings:
            self.readings.take(batch)
        frames = batch.frames[: batch.n]
        patches = self._patch_of[frames["bus"], frames["can_id"]]
        self._fresh_ns[patches[patches >= 0]] = now_ns

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Take frames; return requests to the master."""
        if self.robot:
            self.robot.take(frames)
        for frame in frames:
            self._meter.take(frame, now_ns)
            p = self._patch_by_id[frame.bus].get(frame.can_id)
            if p is not None:
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
                self._contacts[slot] = row
                self._came.add(slot)
        if self._open is not None and self._is_complete(self._open):
            self._end_cycle()

    def _is_complete(self, summary: Summary) -> bool:
        """Whether all contacts of the open cycle have come: those seen, and the end of those before it."""
        states = [self._contacts[slot].state for slot in self._came]
        n_seen = sum(state in (ContactState.TOUCH, ContactState.HELD) for state in states)
        return self._live <= self._came and n_seen == min(summary.n_contacts, profile.MAX_CONTACTS)

    def _end_cycle(self) -> None:
        """Hand the open cycle on; it is not complete where a frame was lost."""
        summary, self._open = self._open, None
        if summary is None:
            return
        self._number += 1
        rows = [self._contacts[slot] for slot in sorted(self._came)]
        self._came = set()
        ended = {row.slot for row in rows if row.state in (ContactState.LIFT, ContactState.NONE)}
        # One whose frame was lost is there until a frame says otherwise.
        self._live = (self._live | {row.slot for row in rows}) - ended
        rows += [self._contacts[slot] for slot in sorted(self._live - {row.slot for row in rows})]
        sync_ns = summary.t_ns - 1000 * summary.latency_us
        contacts = self._records([row for row in rows if row.state is not ContactState.NONE], sync_ns)
        layout, patches = self._feed.layout, self._patches(summary.t_ns)
        cycle = ListenedCycle(self._number, summary, layout, self._clock, contacts, patches, self._heard)
        cycle.bus_loads = self._meter.loads(summary.t_ns)
        if self.robot:
            cycle.place_on(self.robot)
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
        places = self._places.setdefault(row.slot, deque())
        if row.state is ContactState.TOUCH:
            places.clear()
        places.append((row.t_ns, row.s, row.a))
        while places[-1][0] - places[0][0] > MOVE_S * 1e9:
            places.popleft()
        _, s, a = places[0]
        surface = self._arm.links[row.link].surface if row.link < len(self._arm.links) else None
        return surface is not None and float(surface.distance(s, a, row.s, row.a)) > SPEED_MOVE * MOVE_S

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
        """Return what goes on of the transfers that the program asked for, one at a time on a bus."""
        if self.requests and not self._clients[self.requests[0][0]].busy:
            bus, index, sub, answer = self.requests.popleft()
            self._clients[bus].start_write(index, sub, profile.ZERO.to_bytes(4, "little"))
            self._asked[bus] = answer
        out: list[Frame] = []
        for bus, (client, asked) in enumerate(zip(self._clients, self._asked, strict=True)):
            if asked is not None:
                own = [frame for frame in frames if frame.bus == bus]
                out += [frame._replace(bus=bus) for frame in client.step(now_ns, own)]
                if client.result is not None:
                    asked.put(client.result)
                    self._asked[bus] = None
        return out


class Answer:
    """Where a thread waits for the end of a transfer of another."""

    def __init__(self) -> None:
        self._came = threading.Event()
        self._result: SdoResult | None = None

    def put(self, result: SdoResult) -> None:
        """Hand it over."""
        self._result = result
        self._came.set()

    def get(self, timeout_s: float) -> None:
        """Wait for it; BusError when none comes, SdoAborted when the master refuses."""
        if not self._came.wait(timeout_s) or self._result is None:
            raise BusError("the master has not answered")
        self._result.unwrap()


class _ListeningFeed(PushFeed):
    """The cycles that a thread receives from the bus."""

    def __init__(self, arm: Arm, node_id: int, readings: bool) -> None:
        super().__init__(SkinLayout.of(arm))
        self._arm = arm
        self._clock = MonotonicClock()
        self.core = ListenCore(arm, node_id, self._clock, self, readings=readings)
        od = load_eds("skin-master", node_id)
        self._zero_all = profile.index_of(od, profile.COMMAND)[0]
        self._zero_one = profile.index_of(od, profile.PATCH_COMMAND)[0]
        self._thread: CoreThread | None = None

    def run_on(self, thread: CoreThread) -> None:
        """Start the thread of the core."""
        self._thread = thread
        thread.start()

    def zero(self, patch: int | None) -> None:
        """Have the master take new zeros."""
        arm, answer = self._arm, Answer()
        if patch is None:
            self.core.requests.append((0, self._zero_all, 0, answer))
        else:
            bus, number = int(arm.patch_bus[patch]), int(arm.node_id[patch])
            self.core.requests.append((bus, self._zero_one, number, answer))
        answer.get(ZERO_S)
        if self.core.readings:
            self.core.readings.zero(patch)

    def set_joints(self, positions: Positions, t_ns: int | None) -> None:
        """Take joint positions of the program."""
        offer_joints(self.core.robot, self._clock.now_ns() if t_ns is None else t_ns, positions)

    def close(self) -> None:
        """End the thread."""
        if self._thread is not None:
            self._thread.stop()
