"""Publishing: contacts and the state of the cycle become objects and TPDOs of the master's node.

The contact records are written column by column through a live view of the process image, so an SDO
client always reads one whole cycle, and a TPDO is a slice of what it would read.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt
from canopen.objectdictionary import ObjectDictionary

from skinbus.estimate import LEVELS, Contacts, Tracks, TrackState
from skinbus.master.gather import FrameCounters
from skinbus.master.pace import Pace
from skinbus.master.patches import PatchTable
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects import profile
from skinbus.objects.contacts import PAYLOAD, ContactState, pack_contacts
from skinbus.objects.pdo import PdoMap, tpdos

AGE_MAX = 0xFFFF
NO_BUDGET = 0xFFFFFFFF
"""Value of "Budget us": the estimator takes the time it takes."""
MAX_NODE_ID = 127


class Publisher:
    """Writes what a cycle found into the device and asks it to send the TPDOs."""

    def __init__(self, arm: Arm, od: ObjectDictionary, device: Device) -> None:
        self._arm = arm
        self._device = device
        first = od[profile.contact(1).object].index
        self._records = device.values.rows(first, profile.MAX_CONTACTS)
        self._used: set[int] = set()
        """Contact records whose TPDO was ever sent."""
        self._cycle = device.values.rows(od[profile.CYCLES.object].index, 1)
        names = (
            profile.FRAMES_ACCEPTED,
            profile.FRAMES_UNKNOWN,
            profile.FRAMES_BAD_LENGTH,
            profile.FRAMES_LOST,
        )
        self._frames = [device.image_view(*profile.index_of(od, name), 1) for name in names]
        maps = tpdos(od)
        self._summary = _number_of(maps, od[profile.CYCLES.object].index)
        self._tpdo = [_number_of(maps, first + k) for k in range(profile.MAX_CONTACTS)]
        node_ids = arm.node_id - 1  # the tables of the EDS are by node-ID from 1
        self._state = device.image_view(od[profile.PATCH_STATE.object].index, 1, MAX_NODE_ID)
        self._age = device.image_view(od[profile.PATCH_AGE_MS.object].index, 1, MAX_NODE_ID)
        self._error = device.image_view(od[profile.PATCH_ERROR.object].index, 1, MAX_NODE_ID)
        self._rows = node_ids

    def contacts(self, now_ns: int, contacts: Contacts, tracks: Tracks) -> npt.NDArray[np.int64]:
        """Write and send the tracks of a cycle; return the identity of each contact, 0 if it has no slot."""
        in_slot = tracks.slot >= 0
        seen = np.flatnonzero(in_slot & (tracks.row >= 0))
        unseen = np.flatnonzero(in_slot & (tracks.row < 0))
        if len(seen):
            self._write(now_ns, contacts, tracks, seen)
        if len(unseen):
            self._write_unseen(now_ns, tracks, unseen)
        slots = tracks.slot[in_slot].tolist()
        self._used.update(slots)
        for slot in slots:
            self._device.transmit_tpdo(self._tpdo[slot])
        ids = np.zeros(len(contacts), np.int64)
        ids[tracks.row[seen]] = tracks.id[seen]
        return ids

    def clear(self) -> None:
        """Take back all contacts: nothing stale is ever shown as fresh."""
        self._records[...] = np.zeros((), self._records.dtype)

    def repeat(self) -> None:
        """Send all records that were ever sent, as they stand: nobody could hear of the last changes."""
        for slot in sorted(self._used):
            self._device.transmit_tpdo(self._tpdo[slot])

    def summary(
        self,
        *,
        counter: int,
        n_contacts: int,
        alive: int,
        flags: int,
        compute_us: int,
        latency_us: int,
        pace: Pace,
        level: str,
        budget_us: float | None,
    ) -> None:
        """Write the state of the cycle and send its TPDO."""
        cycle = self._cycle[0]
        cycle["SYNC counter"] = counter
        cycle["Contact count"] = min(n_contacts, 0xFF)
        cycle["Patches alive"] = min(alive, 0xFF)
        cycle["Cycle flags"] = flags
        cycle["Compute time us"] = min(compute_us, 0xFFFF)
        cycle["Latency 10us"] = min(latency_us // 10, 0xFFFF)
        cycle["Cycles"] = (int(cycle["Cycles"]) + 1) & 0xFFFFFFFF
        cycle["Overruns"] = pace.overruns & 0xFFFFFFFF
        cycle["Cut short"] = pace.cut_short & 0xFFFFFFFF
        cycle["Level"] = LEVELS.index(level)
        cycle["Budget us"] = NO_BUDGET if budget_us is None else min(round(budget_us), NO_BUDGET - 1)
        self._device.transmit_tpdo(self._summary)

    def patches(self, now_ns: int, table: PatchTable, counters: FrameCounters) -> None:
        """Write the patch table and the frame counters (SDO only)."""
        self._state[self._rows] = table.state
        age_ms = np.where(table.last_fresh > 0, (now_ns - table.last_fresh) // 1_000_000, AGE_MAX)
        self._age[self._rows] = np.clip(age_ms, 0, AGE_MAX)
        self._error[self._rows] = table.error
        lost = counters.lost + counters.late + counters.dropped
        values = (counters.accepted, counters.unknown, counters.bad_length, lost)
        for view, value in zip(self._frames, values, strict=True):
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
            records[name] = cov[:, i, j]
        records["Residual"] = c.residual[rows]
        records["s"], records["a"], records["Force"] = s, a, force
        self._records[slots] = records


def _age_ms(now_ns: int, seen_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return how long ago tracks were seen, (n,) ms."""
    return np.clip((now_ns - seen_ns) // 1_000_000, 0, 0xFFFFFFFF)


def _motion(tracks: Tracks, which: npt.NDArray[np.intp]) -> Iterator[tuple[str, npt.NDArray[np.float64]]]:
    """Yield the members of a record that come from the filter; a force is not negative."""
    mean = tracks.mean[which]
    yield "Velocity s", mean[:, 2]
    yield "Velocity a", mean[:, 3]
    yield "Filtered s", mean[:, 0]
    yield "Filtered a", mean[:, 1]
    yield "Filtered force", np.maximum(mean[:, 4], 0.0)


def _number_of(maps: Sequence[PdoMap], index: int) -> int:
    """Return the number of the TPDO whose first mapped object has this index."""
    for pdo in maps:
        if pdo.entries and pdo.entries[0].index == index:
            return pdo.number
    raise ValueError(f"no TPDO maps 0x{index:04X}")
