"""The skin as the master of another process or machine publishes it on the bus.

What its TPDOs carry: contacts rounded to 0.1 mm and 0.01 N, and a summary of each cycle with its level.
Covariances, quality and level of single contacts are read by SDO only, and are not known here; readings are
made into pressures on request.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from pathlib import Path
from threading import Event
from typing import NamedTuple

import numpy as np

from skinbus.bus.core_thread import CoreThread
from skinbus.can.core import Core, Step
from skinbus.can.frame import CobIds, Frame, FrameBatch, Frames
from skinbus.config.system import load_arm, ods_of
from skinbus.errors import BusError
from skinbus.estimate import Baseline, Plausibility, TrackState
from skinbus.master.gather import judge_stamps
from skinbus.master.level_control import split_flags
from skinbus.master.patches.supervisor import HEARTBEAT_FACTOR
from skinbus.master.patches.table import MAX_MISSED, Mask, PatchState
from skinbus.model import Arm
from skinbus.node.sdo_client import SdoClient
from skinbus.objects import cia, profile
from skinbus.objects.contacts import FORCE_STEP, LENGTH_STEP
from skinbus.objects.pdo import carries_readings, tpdos
from skinbus.objects.profile import number_at
from skinbus.objects.published import master_od
from skinbus.objects.readings import N_IDS, ReadingsPlan
from skinbus.skin.addresses import BusAddress, find_places, shown
from skinbus.skin.contact import CONTACT, UNKNOWN_LEVEL, Context, Records
from skinbus.skin.cycle import PATCH, Cycle, Readings, SkinLayout, fill_places
from skinbus.skin.feed import Feed
from skinbus.skin.listener import Heard, Listener
from skinbus.skin.opened import Channel, channel_words
from skinbus.skin.robot_here import RobotHere
from skinbus.skin.skin import Skin

LOOK_NS = 20_000_000
"""How often requests of the program are looked for."""

ZERO_S = 3.0
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


class Request(NamedTuple):
    """A transfer to the master on a bus, and what is set at its end."""

    bus: int
    client: SdoClient
    done: Event


class ListenCore(Core):
    """Receives a master and its patches; sends nothing but the zeros that a program asks for."""

    def __init__(self, arm: Arm, node_id: int, feed: Feed, *, readings: bool = False) -> None:
        self._arm, self._node_id = arm, node_id
        self._feed = feed
        self.n_buses = len(arm.buses)
        self._listener = listener = Listener(node_id)
        self._seen_ns = np.zeros(profile.MAX_CONTACTS, np.int64)
        self._number = self._n_read = 0
        self._fresh_ns = np.zeros(arm.n_patches, np.int64)
        self._heard_ns = np.zeros(arm.n_patches, np.int64)
        self._emcy = np.zeros(arm.n_patches, np.uint32)
        ods = ods_of(arm)
        plan = ReadingsPlan(arm, ods)
        self._silent_ns = np.full(arm.n_patches, (MAX_MISSED + 1) * feed.layout.period_ns)
        np.maximum.at(self._silent_ns, plan.pdo_patch, plan.pause_ns * plan.free)
        lost_ms = [HEARTBEAT_FACTOR * number_at(od, cia.HEARTBEAT_PRODUCER) or np.inf for od in ods]
        self._lost_ns = 1e6 * np.array(lost_ms)
        self._holds = plan.on_sync != plan.expected
        """Patches whose newest readings hold while they are sending: they run freely."""
        self._data_ids = plan.cob_ids_on
        self.readings = ListenedReadings(arm, plan) if readings else None
        """What the patches send as pressures, where that was asked for."""
        self._heard = Readings.none(arm.n_tactels)
        self.robot = RobotHere(arm)
        """Joint positions from the program."""
        self._sent_by = np.full((len(arm.buses), N_IDS), -1, np.int32)
        """Patch that sends an identifier, by bus."""
        for p, (od, bus, number) in enumerate(zip(ods, arm.patch_bus, arm.node_id, strict=True)):
            ids = [pdo.cob_id for pdo in tpdos(od) if carries_readings(pdo)]
            self._sent_by[bus, [*ids, cia.HEARTBEAT_BASE + number, cia.EMCY_BASE + number]] = p
        others = listener.cob_ids | {cia.SDO_SERVER_BASE + node_id}
        self._ids = [frozenset(np.flatnonzero(sent_by >= 0).tolist()) | others for sent_by in self._sent_by]
        self.requests: deque[Request] = deque()
        """What the program asks for."""

    def cob_ids_on(self, bus: int) -> CobIds:
        """Identifiers received on a bus."""
        return self._ids[bus]

    def data_ids_on(self, bus: int) -> CobIds:
        """Identifiers that carry readings."""
        return self._data_ids[bus]

    def take(self, now_ns: int, batch: FrameBatch) -> None:
        """Note which patches send readings, and what."""
        frames = batch.frames[: batch.n]
        patches = self._sent_by[frames["bus"], frames["can_id"]]  # of all: these are their identifiers
        self._fresh_ns[patches] = batch.t_ns[: batch.n]
        if self.readings:
            self.readings.take(batch)

    def step(self, now_ns: int, frames: Frames) -> Step:
        """Take frames; return requests to the master."""
        for frame in frames:  # they may have waited: what they say is as old as they are
            at_ns = min(frame.t_ns, now_ns)
            p = self._sent_by[frame.bus, frame.can_id] if frame.can_id < N_IDS else -1
            if p >= 0:
                self._heard_ns[p] = at_ns
                if frame.can_id < cia.HEARTBEAT_BASE and len(frame.data) >= 2:
                    self._emcy[p] = int.from_bytes(frame.data[:2], "little")
            elif frame.bus == 0:  # contacts are published on all buses alike
                for heard in self._listener.take(at_ns, frame):
                    self._end_readings(at_ns)
                    self._end_cycle(heard)
                self._end_readings(at_ns)
        return Step(self._request(now_ns, frames), (), now_ns + LOOK_NS)

    def _end_readings(self, now_ns: int) -> None:
        """Take the readings before a summary for those of its cycle."""
        if self.readings and self._listener.n_summaries > self._n_read:
            self._n_read = self._listener.n_summaries
            self._heard = self.readings.end_cycle(now_ns, self._is_sending(now_ns))

    def _end_cycle(self, heard: Heard) -> None:
        """Hand a cycle on."""
        self._number += 1
        summary = heard.summary
        sync_ns = summary.t_ns - 1000 * summary.latency_us
        flags, level = split_flags(summary.data[3])
        contacts = self._records(heard, sync_ns)
        placed = self.robot.place(sync_ns, contacts)
        cycle = Cycle(
            self._number,
            sync_ns,
            summary.data[0],
            level,
            flags,
            1e-6 * summary.latency_us,
            Context(self._feed.layout, self._feed.now_ns, lambda: placed),
            contacts,
            self._patches(summary.t_ns),
            self._heard,
        )
        self._feed.push(cycle)

    def ask_zero(self, patch: int | None) -> Request:
        """Ask the master for new zeros of a patch, or of all; from any thread."""
        arm, name = self._arm, profile.COMMAND if patch is None else profile.PATCH_COMMAND
        bus, sub = (0, 0) if patch is None else (int(arm.patch_bus[patch]), int(arm.node_id[patch]))
        request = Request(bus, SdoClient(self._node_id), Event())
        index = profile.index_of(master_od(self._node_id), name)[0]
        request.client.start_write(index, sub, profile.ZERO.to_bytes(4, "little"))
        self.requests.append(request)
        if self.readings:
            self.readings.zero(patch)
        return request

    def _records(self, heard: Heard, sync_ns: int) -> Records:
        records, said = np.zeros(len(heard.slots), CONTACT), heard.contacts
        records["id"], records["state"] = said["id"], said["link_state"] >> 4
        records["link"], records["level"] = said["link_state"] & 0xF, UNKNOWN_LEVEL
        records["s"], records["a"] = LENGTH_STEP * said["s"], LENGTH_STEP * said["a"]
        records["force"] = FORCE_STEP * said["force"]
        is_seen = ~np.isin(records["state"], (TrackState.COAST, TrackState.LIFT))
        self._seen_ns[heard.slots[is_seen]] = sync_ns
        seen_ns = self._seen_ns[heard.slots]
        records["seen_ns"] = np.where(seen_ns > 0, seen_ns, sync_ns)
        fill_places(records, self._arm)
        return records

    def _patches(self, now_ns: int) -> Records:
        """Return the states of patches by what was received from them."""
        records, is_sending = np.zeros(len(self._fresh_ns), PATCH), self._is_sending(now_ns)
        records["state"] = np.select(
            [is_sending, self._fresh_ns > 0, self._heard_ns > 0],
            [PatchState.OPERATIONAL, PatchState.SILENT, PatchState.BOOTING],
            PatchState.ABSENT,
        )
        records["last_fresh_ns"] = np.where(self._holds & is_sending, now_ns, self._fresh_ns)
        records["emcy"] = self._emcy
        return records

    def _is_sending(self, now_ns: int) -> Mask:
        has_sent = (self._fresh_ns > 0) & (now_ns - self._fresh_ns <= self._silent_ns)
        return has_sent & (now_ns - np.maximum(self._fresh_ns, self._heard_ns) <= self._lost_ns)

    def _request(self, now_ns: int, frames: Frames) -> list[Frame]:
        """Return what goes on of the transfers that the program asked for, one at a time."""
        if not self.requests:
            return []
        bus, client, done = self.requests[0]
        out = client.step(now_ns, [frame for frame in frames if frame.bus == bus])
        if client.result is not None:
            self.requests.popleft()
            done.set()
        return [frame._replace(bus=bus) for frame in out]


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
        self._stamps, self._free_ns = plan.new_stamps(), plan.answers().free_ns
        self._baseline = Baseline(arm)
        self._plausibility = Plausibility(arm)
        self._wanted: deque[int | None] = deque()

    def take(self, batch: FrameBatch) -> None:
        """Take data frames."""
        self._plan.unpack_free(batch, self._counts, self._stamps, self._free_ns)
        self._plan.unpack(batch, self._counts, self._seen, self._stamps)

    def end_cycle(self, t_ns: int, is_sending: Mask) -> Readings:
        """Return the readings since the last cycle; a patch of which a frame is missing has none.

        What runs freely holds from cycle to cycle while the patch is one of those sending, (n_patches,).
        """
        plan = self._plan
        self._free_ns[~is_sending[plan.pdo_patch]] = 0
        max_age_ns = 1_000_000 * self._arm.bus.max_age_ms
        is_used, _ = judge_stamps(plan, self._stamps, self._free_ns, t_ns, max_age_ns)
        fresh = (self._seen == plan.on_sync) & is_sending & is_used
        self._seen[:] = 0
        pressures = (self._counts - plan.counts_offset) * plan.counts_scale
        self._plausibility.judge(pressures, t_ns, fresh, self._baseline)
        fresh &= ~self._plausibility.is_withheld
        self._baseline.apply(pressures, t_ns, fresh)
        while self._wanted:
            self._baseline.zero(self._wanted.popleft())
        faults, arm = self._plausibility.faults, self._arm
        valid = fresh[arm.tactel_patch] & arm.tactel_healthy & np.isfinite(pressures) & (faults == 0)
        return Readings(np.where(valid, pressures, 0.0), valid, faults.copy())

    def zero(self, patch: int | None) -> None:
        """Take what is read in the next cycle for zero, on one patch or all; from any thread."""
        self._wanted.append(patch)


class _ListeningFeed(Feed):
    """The cycles that a thread receives from the bus."""

    def __init__(self, arm: Arm, places: Sequence[BusAddress], node_id: int, readings: bool) -> None:
        super().__init__(SkinLayout.of(arm), f"listening on {shown(places)}")
        self._core = ListenCore(arm, node_id, self, readings=readings)
        self.robot = self._core.robot.robot
        self._thread = CoreThread(self._core, *(place.open for place in places), on_end=self.end)
        self._thread.start()

    def zero(self, patch: int | None) -> None:
        """Have the master take new zeros; SdoAborted when it refuses."""
        request = self._core.ask_zero(patch)
        if not request.done.wait(ZERO_S) or request.client.result is None:
            raise BusError("the master has not answered")
        request.client.result.unwrap()

    def close(self) -> None:
        """End the thread."""
        self._thread.stop()
