"""Arms from files: the arm file joined with what each patch's EDS says of its board."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from canopen.objectdictionary import ObjectDictionary

from skinbus.config.arm_file import ArmFile, find_arm, read_arm_file
from skinbus.config.arm_tables import eds_beside
from skinbus.config.guard_tables import guard_settings
from skinbus.config.mesh_links import lay_links
from skinbus.config.mounting import outside, overlap
from skinbus.errors import ConfigError, EdsError, Fault, FaultList
from skinbus.model import Arm, Link, Patch, PlacedPatch
from skinbus.model.guard import GuardSettings
from skinbus.objects import cia
from skinbus.objects.board import describe_patch
from skinbus.objects.bus_load import CLASSIC_BYTES, MAX_LOAD, cyclic_load
from skinbus.objects.eds import load_eds
from skinbus.objects.guard import liveness_pdo
from skinbus.objects.pdo import carries_readings, readings_in, tpdos
from skinbus.objects.profile import (
    GUARD_STATE,
    HEALTHY_TACTELS,
    TACTEL_COUNT,
    current,
    look_up,
)
from skinbus.objects.published import master_tpdos
from skinbus.objects.settings import Settings, freeze

PLACEMENT_TOLERANCE = 1e-3
"""Overlap of two boards, or overhang over the end of a link, that mounting tolerances excuse, m."""


def load_arm(name_or_path: str | Path, *, check_load: bool = True) -> Arm:
    """Return the arm that a file describes, or one of those that ship with skinbus by its name.

    ``check_load=False`` also accepts an arm whose bus would be overloaded, for tools that analyse it.

    Raises:
        ConfigError: no such file, or faults in it or in an EDS it names, all of them.
    """
    return make_arm(read_arm_file(find_arm(name_or_path)), check_load=check_load)


def make_arm(file: ArmFile, *, check_load: bool = True) -> Arm:
    """Return the arm that the tables of a file describe; as :func:`load_arm`."""
    faults = FaultList(file.faults)
    placed, ods = _place(file, faults)
    links: list[Link] = []
    if not faults:
        links, placed = lay_links(file, placed, faults)
    if not faults:
        arm = Arm(file.name, links, placed, *file.buses, robot=file.robot)
        if file.guard:
            arm.guard = guard_settings(file.guard, arm, faults)
            arm.patches = tuple(_with_liveness(arm, arm.guard, ods, faults))
            ods = ods_of(arm)
        _check_geometry(arm, faults)
        _check_pdos(arm, ods, faults)
        if check_load:
            _check_load(arm, ods, faults)
        if not faults:
            return arm
    raise ConfigError(file.path, faults)


def ods_of(arm: Arm) -> list[ObjectDictionary]:
    """Return the object dictionaries of the patches of an arm, each on its node-ID.

    Equal patches on several buses share one.

    Raises:
        EdsError: a patch names an EDS that does not exist or has faults.
        ValueError: the EDS of a patch describes another number of tactels than the arm has.
    """
    ods, load = [], cache(load_eds)
    for placed in arm.patches:
        od = load(placed.eds, placed.node_id, settings=placed.settings, serial=placed.serial)
        n_tactels = current(look_up(od, TACTEL_COUNT))
        if n_tactels != placed.patch.n_tactels:
            raise ValueError(f"{placed.eds} has {n_tactels!r} tactels; the arm has {placed.patch.n_tactels}")
        ods.append(od)
    return ods


def _place(file: ArmFile, faults: FaultList) -> tuple[list[PlacedPatch], list[ObjectDictionary]]:
    """Return placed patches and their dictionaries; a fault of an EDS of several is said once."""
    placed, ods, load = [], [], cache(load_eds)
    known: dict[tuple[str, Settings], Patch] = {}
    faulty = set[tuple[str, Settings]]()
    for mounting in file.mountings:
        if faults.n_more:  # ten of a kind are listed; each board takes a while
            break
        board = mounting.board
        kind = eds, settings = eds_beside(board.eds, file.path), freeze(board.set)
        if kind in faulty:
            continue
        try:
            if (counter := file.buses[0].sync_counter) and cia.SYNC_COUNTER_OVERFLOW in load_eds(eds, 1):
                settings = ((f"0x{cia.SYNC_COUNTER_OVERFLOW:04X}", counter), *settings)
            od = load(eds, board.node_id, settings=settings, serial=board.serial)
            patch = known[kind] = known.get(kind) or describe_patch(od, eds)
        except EdsError as error:
            faulty.add(kind)
            faults += [_at(mounting.key, error.file, fault) for fault in error.faults]
            continue
        ods.append(od)
        placed.append(
            PlacedPatch(
                patch=patch.mirrored() if board.mirrored else patch,
                key=mounting.key,
                node_id=board.node_id,
                link=mounting.link,
                s=1e-3 * (board.s_mm or 0.0),
                a=file.links[mounting.link].across(board),
                yaw=math.radians(board.yaw_deg),
                eds=eds,
                settings=settings,
                serial=board.serial,
                bus=mounting.bus,
                address=board.address,
            )
        )
    return placed, ods


def _at(key: str, eds: str, fault: Fault) -> Fault:
    """Return a fault of a patch's EDS, or of its settings, as one of the arm file."""
    ours = fault.key.startswith(("set.", "serial"))
    return Fault(
        f"{key}.{fault.key}" if ours else f"{key}.eds {eds} {fault.key}",
        fault.seen,
        fault.wanted,
    )


def _with_liveness(
    arm: Arm, guard: GuardSettings, ods: Sequence[ObjectDictionary], faults: FaultList
) -> Iterator[PlacedPatch]:
    """Yield the patches; those with limits send the state of their guard."""
    for placed, od, guards in zip(arm.patches, ods, arm.guarded, strict=True):
        pdo = liveness_pdo(od) if guards else None
        if pdo and pdo.cob_id <= cia.LAST_PDO_ID:
            sets = f"0x{cia.TPDO_COMMUNICATION + pdo.number - 1:04X}"
            own = (
                (f"{sets}:{cia.PDO_COB_ID}", pdo.cob_id | cia.COB_ID_NO_RTR),
                (f"{sets}:{cia.PDO_EVENT_TIMER}", guard.liveness_ns // 1_000_000),
            )
            yield replace(placed, settings=(*own, *placed.settings))
            continue
        if guards:
            wanted = f"a TPDO for {GUARD_STATE!r}, up to 0x{cia.LAST_PDO_ID:X}: another node-ID or board"
            faults.add(placed.key, f"COB-ID 0x{pdo.cob_id:X}" if pdo else None, wanted)
        yield placed


def _check_geometry(arm: Arm, faults: FaultList) -> None:
    """Add the faults of places on links."""
    for k, link in enumerate(arm.links):
        surface = link.surface
        own = [patch for patch in arm.patches if patch.link == k]
        for patch in own:
            # all tactels are on a mesh; boards may overhang its rim
            over = outside(surface, patch) if patch.on_chart is None else 0.0
            if over > PLACEMENT_TOLERANCE:
                where = f"{1e3 * over:.1f} mm beyond link {link.name!r}"
                faults.add(patch.key, None, f"a place where it does not stick out {where}")
        places = [(patch.s, patch.a, 0.5 * math.hypot(*patch.patch.size)) for patch in own]
        s, a, reach = np.reshape(places, (-1, 3)).T
        is_near = surface.distance(s[:, None], a[:, None], s, a) < reach[:, None] + reach
        for p, q in np.argwhere(np.triu(is_near, 1)):
            depth = overlap(surface, own[p], own[q])
            if depth > PLACEMENT_TOLERANCE:
                seen = f"{1e3 * depth:.1f} mm of overlap"
                faults.add(f"{own[p].key} and {own[q].key}", seen, "patches side by side")


def _check_pdos(arm: Arm, ods: Sequence[ObjectDictionary], faults: FaultList) -> None:
    """Add the faults of TPDOs; all readings of a board must be sent: one that is missing passes as zero."""
    of_master = [pdo.cob_id for pdo in master_tpdos()]
    seen = {(k, cob_id): "the master" for k in range(len(arm.buses)) for cob_id in of_master}
    for placed, od in zip(arm.patches, ods, strict=True):
        pdos = [pdo for pdo in tpdos(od) if pdo.valid]
        for pdo in pdos:
            key, taken = (
                f"{placed.key} TPDO {pdo.number}",
                seen.setdefault((placed.bus, pdo.cob_id), placed.key),
            )
            if pdo.length > CLASSIC_BYTES and arm.buses[placed.bus].data_bitrate is None:
                wanted = f"at most {CLASSIC_BYTES}, or a bus with canfd = true"
                faults.add(key, f"{pdo.length} bytes", wanted)
            if taken != placed.key:
                faults.add(key, f"COB-ID 0x{pdo.cob_id:03X}", f"another: {taken} has it")
        sent = {entry.sub for pdo in pdos if carries_readings(pdo) for entry in readings_in(pdo)}
        n_tactels = placed.patch.n_tactels
        healthy = np.flatnonzero(np.broadcast_to(placed.patch.healthy, n_tactels)) + 1
        if silent := sorted({*healthy.tolist()} - sent):
            some = ", ".join(map(str, silent[:4])) + (", ..." if len(silent) > 4 else "")
            what = f"{len(silent)} of {n_tactels} readings in no enabled TPDO: {some}"
            wanted = f"all of them, or their bits in {str(HEALTHY_TACTELS)!r} cleared"
            faults.add(f"{placed.key}.eds {placed.eds}", what, wanted)


def _check_load(arm: Arm, ods: Sequence[ObjectDictionary], faults: FaultList) -> None:
    """Say of every bus that would be too full at which rate it would not."""
    for k, bus in enumerate(arm.buses):
        load = cyclic_load(arm, ods, k)
        if load > MAX_LOAD:
            highest = bus.rate_hz * MAX_LOAD / load
            name = f"bus {bus.name}" if bus.name else "the bus"
            full = f"{name} would be {100 * load:.0f} % full, {100 * MAX_LOAD:.0f} % is the limit"
            faults.add("arm.rate_hz", bus.rate_hz, f"at most {highest:.1f}: {full}")
