"""Publishing: contacts and the state of the cycle become objects and TPDOs of the master's nodes.

The node of every bus shows the same contacts; patches are shown by the node of their bus.

The contact records are written column by column through a live view of the process image, so an SDO
client always reads one whole cycle, and a TPDO is a slice of what it would read.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinbus.arrays import Bools, Floats, Ints
from skinbus.estimate import LEVELS, Contacts, Loads, Tracks, TrackState
from skinbus.master.cycle import CycleReport
from skinbus.master.gather import FrameCounters
from skinbus.master.level_control import LevelControl, with_level
from skinbus.master.patches.table import PatchTable
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects import cia, profile
from skinbus.objects.contacts import (
    FORCE_STEP,
    MAX_LINKS,
    PAYLOAD,
    ContactState,
    pack_contacts,
    pack_deviations,
)
from skinbus.objects.published import FIRST_CONTACT, FIRST_QUALITY, LOAD, SUMMARY

AREA_STEP = 1e-6
"""m^2 per count of a touched area."""
AGE_MAX = 0xFFFF
REAL32_MAX = float(np.finfo(np.float32).max)
NO_BUDGET = 0xFFFFFFFF
"""Value of "Budget us": the estimator takes the time it takes."""

OF_PATCHES = (profile.PATCH_LOAD, profile.PATCH_LOAD_SD, profile.PATCH_AREA)
OF_LINKS = (
    profile.LINK_LOAD,
    profile.LINK_LOAD_SD,
    profile.LINK_LOAD_S,
    profile.LINK_LOAD_A,
    profile.LINK_LOAD_PLACE_SD,
    profile.LINK_AREA,
)
OF_STATES = (profile.PATCH_STATE, profile.PATCH_AGE_MS, profile.PATCH_ERROR)
COVARIANCES = (
    ("Variance s", 0, 0),
    ("Covariance s a", 0, 1),
    ("Variance a", 1, 1),
    ("Covariance s force", 0, 2),
    ("Covariance a force", 1, 2),
    ("Variance force", 2, 2),
)


class _Node:
    """Live views of the objects in the device of one bus; tables of patches are by node-ID from 1."""

    def __init__(self, arm: Arm, bus: int, device: Device) -> None:
        self.device = device
        self.patches = arm.patches_on(bus)
        self.rows = arm.node_id[self.patches] - 1

        self.records = device.rows_of(profile.CONTACT, profile.MAX_CONTACTS)
        self.cycle = device.rows_of(profile.CYCLES, 1)
        self.load = device.rows_of(profile.LOAD, 1)
        self.frames = device.rows_of(profile.FRAMES, 1)
        self.states = [device.view_of(name, cia.MAX_NODE_ID) for name in OF_STATES]
        self.patch_loads = [device.view_of(name, cia.MAX_NODE_ID) for name in OF_PATCHES]
        self.link_loads = [device.view_of(name, MAX_LINKS) for name in OF_LINKS]


class Publisher:
    """Writes what a cycle found into the devices, one for each bus, and asks them to send the TPDOs."""

    def __init__(self, arm: Arm, devices: Sequence[Device]) -> None:
        self._arm = arm
        self._nodes = [_Node(arm, k, device) for k, device in enumerate(devices)]
        self._records = self._nodes[0].records
        self._used: set[int] = set()
        self._loads: Loads | None = None

    def contacts(self, now_ns: int, contacts: Contacts, tracks: Tracks) -> Ints:
        """Write and send the tracks of a cycle; return the identity of each contact, 0 if it has no slot."""
        in_slot = tracks.slot >= 0
        seen = in_slot & (tracks.row >= 0)
        if in_slot.any():
            self._write(now_ns, contacts, tracks, in_slot)
        slots = tracks.slot[in_slot].tolist()
        self._used.update(slots)
        for node in self._nodes:
            node.records[...] = self._records
            self._send(node.device, slots)
        ids = np.zeros(len(contacts), np.int64)
        ids[tracks.row[seen]] = tracks.id[seen]
        return ids

    def clear(self) -> None:
        """Take back all contacts and loads: nothing stale is ever shown as fresh."""
        self._loads = None
        for node in self._nodes:
            for records in (node.records, node.load):
                records[...] = np.zeros((), records.dtype)
            for view in (*node.patch_loads, *node.link_loads):
                view[...] = 0.0

    def repeat(self, bus: int) -> None:
        """Send contacts, ended ones too, and the load on a bus: what was sent before may not have come."""
        device = self._nodes[bus].device
        self._send(device, sorted(self._used))
        device.transmit_tpdo(LOAD)

    def _send(self, device: Device, slots: Sequence[int]) -> None:
        """Send what the slots hold: contacts, and how sure they are where these TPDOs are enabled."""
        for slot in slots:
            for first in (FIRST_CONTACT, FIRST_QUALITY):
                device.transmit_tpdo(first + slot)

    def summary(self, report: CycleReport, level_control: LevelControl, n_faulty: int) -> None:
        """Write the state of the cycle and send its TPDO; ``n_faulty`` tactels are not plausible."""
        budget_us = report.budget_us
        cycle = self._nodes[0].cycle[0]
        values = {
            "SYNC counter": report.counter,
            "Contact count": min(len(report.contacts), 0xFF),
            "Cycle flags": with_level(report.flags, report.level),
            "Compute time us": min(report.compute_ns // 1000, 0xFFFF),
            "Latency 10us": min(report.latency_ns // 10_000, 0xFFFF),
            "Cycles": (int(cycle["Cycles"]) + 1) & 0xFFFFFFFF,
            "Overruns": level_control.overruns & 0xFFFFFFFF,
            "Cut short": level_control.cut_short & 0xFFFFFFFF,
            "Implausible tactels": min(n_faulty, 0xFFFF),
            "Level": LEVELS.index(report.level),
            "Budget us": NO_BUDGET if budget_us is None else min(round(budget_us), NO_BUDGET - 1),
        }
        for name, value in values.items():
            cycle[name] = value
        for node in self._nodes:
            node.cycle[0] = cycle
            node.cycle[0]["Patches alive"] = report.fresh[node.patches].sum()
            node.device.transmit_tpdo(SUMMARY)

    def loads(self, loads: Loads) -> None:
        """Write the loads of a cycle and send that of the arm, if its TPDO is enabled."""
        for node in self._nodes:
            if loads is not self._loads:  # those of a skin that nothing touches are written once
                _write_loads(node, loads)
            node.device.transmit_tpdo(LOAD)
        self._loads = loads

    def patches(self, bus: int, now_ns: int, table: PatchTable) -> None:
        """Write the table of the patches of a bus (SDO only)."""
        rows = self._nodes[bus].rows
        state, age, error = self._nodes[bus].states
        state[rows] = table.state
        age_ms = np.where(table.last_fresh > 0, (now_ns - table.last_fresh) // 1_000_000, AGE_MAX)
        age[rows] = np.clip(age_ms, 0, AGE_MAX)
        error[rows] = table.error

    def frames(self, counters: FrameCounters) -> None:
        """Write the frame counters, those of all buses (SDO only)."""
        values = counters.accepted, counters.unknown, counters.bad_length, counters.lost
        for node in self._nodes:
            node.frames[0] = tuple(value & 0xFFFFFFFF for value in values)

    def _write(self, now_ns: int, c: Contacts, tracks: Tracks, which: Bools) -> None:
        """Write tracks as they were seen last, and the raw estimates of those seen in this cycle.

        One that has ended has no force.
        """
        slots, link, patch = tracks.slot[which], tracks.link[which], tracks.patch[which]
        s, a, state, mean = tracks.s[which], tracks.a[which], tracks.state[which], tracks.mean[which]
        force, filtered = np.where(state == TrackState.LIFT, 0.0, [tracks.force[which], mean[:, 4]])
        said = np.where(state == TrackState.MOVE, ContactState.HELD, state)
        packed = pack_contacts(id=tracks.id[which], link=link, state=said, s=s, a=a, force=force)
        points, normals = np.zeros((2, len(slots), 3))
        for number in np.unique(link):
            here = link == number
            points[here], normals[here] = self._arm.links[number].surface.position(s[here], a[here])
        columns = {
            **{
                member: packed[field]
                for member, field in zip(profile.CONTACT_MEMBERS, PAYLOAD.names or (), strict=False)
            },
            **dict(zip(("Filtered s", "Filtered a", "Velocity s", "Velocity a"), mean.T, strict=False)),
            "Filtered force": np.maximum(filtered, 0.0),
            "Identity": tracks.identity[which],
            "Node-ID": self._arm.node_id[patch],
            "Bus": self._arm.patch_bus[patch] + 1,
            "Age ms": np.clip((now_ns - tracks.seen_ns[which]) // 1_000_000, 0, 0xFFFFFFFF),
            **dict(zip("xyz", points.T, strict=True)),
            **dict(zip(("nx", "ny", "nz"), normals.T, strict=True)),
            "s": s,
            "a": a,
            "Force": force,
        }
        records, is_seen = self._records[slots], tracks.row[which] >= 0
        for member, column in columns.items():
            records[member] = column
        rows = tracks.row[which][is_seen]
        place_sd, force_sd = pack_deviations(c.covariance[rows])
        estimates = {
            "Level": [LEVELS.index(level) for level in c.level[rows]],
            "Quality": c.quality[rows],
            "Place sd 0.1mm": place_sd,
            "Force sd 0.05N": force_sd,
            "Tactels used": np.minimum(c.n_tactels[rows], 0xFF),
            "Time ns": max(c.t_ns, 0),
            **{name: _real32(c.covariance[rows, i, j]) for name, i, j in COVARIANCES},
            "Residual": _real32(c.residual[rows]),
        }
        for member, column in estimates.items():
            records[member][is_seen] = column
        self._records[slots] = records


def _write_loads(node: _Node, loads: Loads) -> None:
    patches, links = loads.patches, loads.links
    n = min(len(links.force), MAX_LINKS)
    place_sd = np.where(np.isfinite(links.place_sd), links.place_sd, 0.0)
    of_patches = (patches.force, patches.force_sd, patches.area)
    of_links = (links.force, links.force_sd, links.s, links.a, place_sd, links.area)
    for view, column in zip(node.patch_loads, of_patches, strict=True):
        view[node.rows] = column[node.patches]
    for view, column in zip(node.link_loads, of_links, strict=True):
        view[:n] = column[:n]
    values = {
        "Force": loads.force,
        "Force sd": loads.force_sd,
        "Touched area": loads.area,
        "Touched area sd": loads.area_sd,
        "Force 0.01N": _counts(loads.force, FORCE_STEP, 0xFFFFFFFF),
        "Force sd 0.01N": _counts(loads.force_sd, FORCE_STEP, 0xFFFF),
        "Touched area mm2": _counts(loads.area, AREA_STEP, 0xFFFF),
    }
    for name, value in values.items():
        node.load[0][name] = value


def _counts(value: float, step: float, most: int) -> int:
    """Return a value in counts, saturating at 0 and ``most``."""
    return round(min(max(value / step, 0.0), most))


def _real32(values: Floats) -> Floats:
    """Return values that fit into a REAL32: what is not known at all has a variance, not an infinite one."""
    return np.clip(values, -REAL32_MAX, REAL32_MAX)
