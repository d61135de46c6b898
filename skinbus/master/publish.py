"""Publishing: contacts and the state of the cycle become objects and TPDOs of the master's nodes.

The node of every bus shows the same contacts; patches are shown by the node of their bus.

The contact records are written column by column through a live view of the process image, so an SDO
client always reads one whole cycle, and a TPDO is a slice of what it would read.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt
from canopen.objectdictionary import ObjectDictionary

from skinbus.estimate import LEVELS, Contacts, Loads, Tracks, TrackState
from skinbus.master.gather import FrameCounters
from skinbus.master.level_control import LevelControl, with_level
from skinbus.master.patches.table import PatchTable
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects import cia, profile
from skinbus.objects.contacts import FORCE_STEP, MAX_LINKS, PAYLOAD, ContactState, pack_contacts
from skinbus.objects.eds import load_eds
from skinbus.objects.published import published

OF_PATCHES = (profile.PATCH_LOAD, profile.PATCH_LOAD_SD, profile.PATCH_AREA)
OF_LINKS = (
    profile.LINK_LOAD,
    profile.LINK_LOAD_SD,
    profile.LINK_LOAD_S,
    profile.LINK_LOAD_A,
    profile.LINK_LOAD_PLACE_SD,
    profile.LINK_AREA,
)
AREA_STEP = 1e-6
"""m^2 per count of a touched area."""


class LoadObjects:
    """Writes loads into the devices, one for each bus: patches into that of their bus, all else into all."""

    def __init__(self, arm: Arm, devices: Sequence[Device], od: ObjectDictionary) -> None:
        self._of_arm = [device.values.rows(od[profile.LOAD.object].index, 1) for device in devices]
        self._patches = [arm.patches_on(k) for k in range(len(devices))]
        self._rows = [arm.node_id[patches] - 1 for patches in self._patches]
        self._of_patches, self._of_links = (
            [[device.image_view(od[name.object].index, 1, most) for name in names] for device in devices]
            for names, most in ((OF_PATCHES, cia.MAX_NODE_ID), (OF_LINKS, MAX_LINKS))
        )
        self._n_links = min(len(arm.links), MAX_LINKS)
        self._written: Loads | None = None

    def write(self, loads: Loads) -> None:
        """Write the loads of a cycle; those of a skin that nothing touches are written once."""
        if loads is self._written:
            return
        self._written = loads
        patches, links, n = loads.patches, loads.links, self._n_links
        place_sd = np.where(np.isfinite(links.place_sd), links.place_sd, 0.0)
        of_links = (links.force, links.force_sd, links.s, links.a, place_sd, links.area)
        for part, rows, views, more in zip(
            self._patches, self._rows, self._of_patches, self._of_links, strict=True
        ):
            for view, column in zip(views, (patches.force, patches.force_sd, patches.area), strict=True):
                view[rows] = column[part]
            for view, column in zip(more, of_links, strict=True):
                view[:n] = column[:n]
        for record in self._of_arm:
            row = record[0]
            row["Force"], row["Force sd"] = loads.force, loads.force_sd
            row["Touched area"], row["Touched area sd"] = loads.area, loads.area_sd
            row["Force 0.01N"] = _counts(loads.force, FORCE_STEP, 0xFFFFFFFF)
            row["Force sd 0.01N"] = _counts(loads.force_sd, FORCE_STEP, 0xFFFF)
            row["Touched area mm2"] = _counts(loads.area, AREA_STEP, 0xFFFF)

    def clear(self) -> None:
        """Write no load."""
        self._written = None
        for rows, views, more in zip(self._rows, self._of_patches, self._of_links, strict=True):
            for view in views:
                view[rows] = 0.0
            for view in more:
                view[: self._n_links] = 0.0
        for record in self._of_arm:
            record[...] = np.zeros((), record.dtype)


def _counts(value: float, step: float, most: int) -> int:
    """Return a value in counts, saturating at 0 and ``most``."""
    return round(min(max(value / step, 0.0), most))


AGE_MAX = 0xFFFF
REAL32_MAX = float(np.finfo(np.float32).max)
NO_BUDGET = 0xFFFFFFFF
"""Value of "Budget us": the estimator takes the time it takes."""


class Publisher:
    """Writes what a cycle found into the devices, one for each bus, and asks them to send the TPDOs."""

    def __init__(self, arm: Arm, devices: Sequence[Device]) -> None:
        self._arm = arm
        od = load_eds("skin-master", devices[0].node_id)
        first = od[profile.contact(1).object].index
        self._devices = tuple(devices)
        self._all_records = [device.values.rows(first, profile.MAX_CONTACTS) for device in devices]
        self._records = self._all_records[0]
        self._used: set[int] = set()
        self._cycle = [device.values.rows(od[profile.CYCLES.object].index, 1) for device in devices]
        names = (
            profile.FRAMES_ACCEPTED,
            profile.FRAMES_UNKNOWN,
            profile.FRAMES_BAD_LENGTH,
            profile.FRAMES_LOST,
        )
        self._frames = [
            [device.image_view(*profile.index_of(od, name), 1) for name in names] for device in devices
        ]
        objects = published(od)
        self._summary = objects.summary.number
        self._tpdo = [pdo.number for pdo in objects.contacts]
        self._load_tpdo = objects.load.number
        self._load = LoadObjects(arm, devices, od)
        self._patches = [arm.patches_on(k) for k in range(len(devices))]
        self._rows = [arm.node_id[patches] - 1 for patches in self._patches]
        """By bus: the tables of the EDS are by node-ID from 1."""
        tables = (profile.PATCH_STATE, profile.PATCH_AGE_MS, profile.PATCH_ERROR)
        self._tables = [
            [device.image_view(od[name.object].index, 1, cia.MAX_NODE_ID) for name in tables]
            for device in devices
        ]

    def contacts(self, now_ns: int, contacts: Contacts, tracks: Tracks) -> npt.NDArray[np.int64]:
        """Write and send the tracks of a cycle; return the identity of each contact, 0 if it has no slot."""
        in_slot = tracks.slot >= 0
        seen = np.flatnonzero(in_slot & (tracks.row >= 0))
        unseen = np.flatnonzero(in_slot & (tracks.row < 0))
        if len(seen):
            self._write(now_ns, contacts, tracks, seen)
        if len(unseen):
            self._write_unseen(now_ns, tracks, unseen)
        for records in self._all_records[1:]:
            records[...] = self._records
        slots = tracks.slot[in_slot].tolist()
        self._used.update(slots)
        for device in self._devices:
            for slot in slots:
                device.transmit_tpdo(self._tpdo[slot])
        ids = np.zeros(len(contacts), np.int64)
        ids[tracks.row[seen]] = tracks.id[seen]
        return ids

    def clear(self) -> None:
        """Take back all contacts and loads: nothing stale is ever shown as fresh."""
        for records in self._all_records:
            records[...] = np.zeros((), records.dtype)
        self._load.clear()

    def repeat(self, bus: int) -> None:
        """Send contacts, ended ones too, and the load on a bus: what was sent before may not have come."""
        for slot in sorted(self._used):
            self._devices[bus].transmit_tpdo(self._tpdo[slot])
        self._devices[bus].transmit_tpdo(self._load_tpdo)

    def summary(
        self,
        *,
        counter: int,
        n_contacts: int,
        fresh: npt.NDArray[np.bool_],
        n_faulty: int,
        flags: int,
        compute_us: int,
        latency_us: int,
        level_control: LevelControl,
        level: str,
        budget_us: float | None,
    ) -> None:
        """Write the state of the cycle and send its TPDO.

        ``fresh`` (n_patches,) are alive; ``n_faulty`` tactels are not plausible.
        """
        cycle = self._cycle[0][0]
        cycle["SYNC counter"] = counter
        cycle["Contact count"] = min(n_contacts, 0xFF)
        cycle["Cycle flags"] = with_level(flags, level)
        cycle["Compute time us"] = min(compute_us, 0xFFFF)
        cycle["Latency 10us"] = min(latency_us // 10, 0xFFFF)
        cycle["Cycles"] = (int(cycle["Cycles"]) + 1) & 0xFFFFFFFF
        cycle["Overruns"] = level_control.overruns & 0xFFFFFFFF
        cycle["Cut short"] = level_control.cut_short & 0xFFFFFFFF
        cycle["Implausible tactels"] = min(n_faulty, 0xFFFF)
        cycle["Level"] = LEVELS.index(level)
        cycle["Budget us"] = NO_BUDGET if budget_us is None else min(round(budget_us), NO_BUDGET - 1)
        for device, own, patches in zip(self._devices, self._cycle, self._patches, strict=True):
            own[0] = cycle
            own[0]["Patches alive"] = fresh[patches].sum()
            device.transmit_tpdo(self._summary)

    def loads(self, loads: Loads) -> None:
        """Write the loads of a cycle and send that of the arm, if its TPDO is enabled."""
        self._load.write(loads)
        for device in self._devices:
            device.transmit_tpdo(self._load_tpdo)

    def patches(self, bus: int, now_ns: int, table: PatchTable) -> None:
        """Write the table of the patches of a bus (SDO only)."""
        rows = self._rows[bus]
        state, age, error = self._tables[bus]
        state[rows] = table.state
        age_ms = np.where(table.last_fresh > 0, (now_ns - table.last_fresh) // 1_000_000, AGE_MAX)
        age[rows] = np.clip(age_ms, 0, AGE_MAX)
        error[rows] = table.error

    def frames(self, counters: FrameCounters) -> None:
        """Write the frame counters, those of all buses (SDO only)."""
        values = (counters.accepted, counters.unknown, counters.bad_length, counters.lost)
        for views in self._frames:
            for view, value in zip(views, values, strict=True):
                view[0] = value & 0xFFFFFFFF

    def _write_unseen(self, now_ns: int, tracks: Tracks, which: npt.NDArray[np.intp]) -> None:
        """Say of tracks that they coast or have ended: as last seen, but a lifted one has no force."""
        slots = tracks.slot[which]
        self._records["Link and state"][slots] = tracks.link[which] & 0xF | tracks.state[which] << 4
        self._records["Age ms"][slots] = _age_ms(now_ns, tracks.seen_ns[which])
        lifted = slots[tracks.state[which] == TrackState.LIFT]
        for member in ("Force 0.01N", "Force"):
            self._records[member][lifted] = 0
        for member, column in _motion(tracks, which):
            self._records[member][slots] = column

    def _write(self, now_ns: int, c: Contacts, tracks: Tracks, which: npt.NDArray[np.intp]) -> None:
        """Write the raw estimates of the tracks seen in this cycle, and their motion."""
        slots, rows = tracks.slot[which], tracks.row[which]
        records = np.zeros(len(slots), self._records.dtype)
        link, s, a, force = c.link[rows], c.s[rows], c.a[rows], c.force[rows]
        state = np.where(tracks.state[which] == TrackState.TOUCH, ContactState.TOUCH, ContactState.HELD)
        payload = pack_contacts(id=tracks.id[which], link=link, state=state, s=s, a=a, force=force)
        for member, field in zip(profile.CONTACT_MEMBERS, PAYLOAD.names or (), strict=False):
            records[member] = payload.view(PAYLOAD)[:, 0][field]
        records["Identity"] = tracks.identity[which]
        for member, column in _motion(tracks, which):
            records[member] = column
        records["Level"] = [LEVELS.index(level) for level in c.level[rows]]
        records["Quality"] = c.quality[rows]
        records["Tactels used"] = np.minimum(c.n_tactels[rows], 0xFF)
        records["Node-ID"] = self._arm.node_id[c.patch[rows]]
        records["Bus"] = self._arm.patch_bus[c.patch[rows]] + 1
        records["Age ms"] = _age_ms(now_ns, tracks.seen_ns[which])
        records["Time ns"] = max(c.t_ns, 0)
        for number in np.unique(link):
            here = link == number
            points, normals = self._arm.links[number].surface.position(s[here], a[here])
            for axis in range(3):
                records["xyz"[axis]][here] = points[:, axis]
                records["n" + "xyz"[axis]][here] = normals[:, axis]
        cov = c.covariance[rows]
        names = (
            ("Variance s", 0, 0),
            ("Covariance s a", 0, 1),
            ("Variance a", 1, 1),
            ("Covariance s force", 0, 2),
            ("Covariance a force", 1, 2),
            ("Variance force", 2, 2),
        )
        for name, i, j in names:
            records[name] = _real32(cov[:, i, j])
        records["Residual"] = _real32(c.residual[rows])
        records["s"], records["a"], records["Force"] = s, a, force
        self._records[slots] = records


def _age_ms(now_ns: int, seen_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return how long ago tracks were seen, (n,) ms."""
    return np.clip((now_ns - seen_ns) // 1_000_000, 0, 0xFFFFFFFF)


def _real32(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return values that fit into a REAL32: what is not known at all has a variance, not an infinite one."""
    return np.clip(values, -REAL32_MAX, REAL32_MAX)


def _motion(tracks: Tracks, which: npt.NDArray[np.intp]) -> Iterator[tuple[str, npt.NDArray[np.float64]]]:
    """Yield the members of a record that come from the filter; a force is not negative."""
    mean = tracks.mean[which]
    yield "Velocity s", mean[:, 2]
    yield "Velocity a", mean[:, 3]
    yield "Filtered s", mean[:, 0]
    yield "Filtered a", mean[:, 1]
    yield "Filtered force", np.maximum(mean[:, 4], 0.0)
