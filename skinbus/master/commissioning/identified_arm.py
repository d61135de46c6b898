"""Places of an arm file for an identification, and what it changes in the file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from skinbus.config.placement import Mounting
from skinbus.master.commissioning.identification import Identified, Place
from skinbus.master.commissioning.lss import Address
from skinbus.master.commissioning.node_id_assignment import Assignment, Known
from skinbus.master.commissioning.unplaced_boards import kinds_of
from skinbus.model import Arm

SERIAL: Final = 3
"""Of the numbers of an identity."""


def places_of(arm: Arm, mountings: Sequence[Mounting]) -> list[Place]:
    """Return the places of the patches of an arm with one bus, and of their tables in its file."""
    places = []
    for placed, mounting, kind in zip(arm.patches, mountings, kinds_of(arm), strict=True):
        link = arm.links[placed.link]
        where = f"{link.name}, s {1e3 * placed.s:.0f} mm"
        if link.surface.period:
            where += f", angle {math.degrees(placed.a / link.surface.radius):.0f} deg"
        else:
            where += f", a {1e3 * placed.a:.0f} mm"
        around = "larger angle" if link.surface.period else "larger a"
        places.append(Place(mounting.key, where, kind.kind, placed.patch.size, placed.yaw, around))
    return places


def changes_of(
    mountings: Sequence[Mounting],
    found: Mapping[str, Identified],
    *,
    new_numbers: frozenset[int] = frozenset(),
) -> dict[str, dict[str, Any]]:
    """Return what is to change in the tables of an arm file, by key.

    The file of a board that was calibrated goes where the board is: it is known by its serial number, else by
    its node-ID, but not by one in ``new_numbers``, which it was given since. A place at which no board was
    found gets a node-ID that is left when another place has its.
    """
    changes: dict[str, dict[str, Any]] = {}
    taken = {own.node_id for own in found.values()}
    left = [m.node_id for m in mountings if m.node_id not in taken]
    kept = {m.node_id for m in mountings if m.key not in found} - taken
    spare = [node_id for node_id in left if node_id not in kept]
    for mounting in mountings:
        own = found.get(mounting.key)
        change: dict[str, Any] = {}
        if own is None:
            if mounting.node_id in taken and spare:
                change["node_id"] = spare.pop(0)
        else:
            change = _change(mounting, own)
            eds = _eds_of(own, mountings, new_numbers)
            if eds and eds != mounting.eds:
                change["eds"] = eds
        if change:
            changes[mounting.key] = change
    return changes


def wanted_numbers(found: Mapping[str, Identified], mountings: Sequence[Mounting]) -> list[Known]:
    """Return the boards with the node-IDs that the arm file has for their places; none if all have them."""
    wanted = {mounting.key: mounting.node_id for mounting in mountings}
    if all(own.node_id == wanted[key] for key, own in found.items()):
        return []
    return [Known(Address(*own.identity), wanted[key]) for key, own in found.items()]


def with_numbers(found: Mapping[str, Identified], results: Sequence[Assignment]) -> dict[str, Identified]:
    """Return the boards with the node-IDs that they have after an assignment."""
    has = {result.address: result.node_id for result in results if result.outcome.is_good}
    return {
        key: replace(own, node_id=has.get(Address(*own.identity), own.node_id)) for key, own in found.items()
    }


def _change(mounting: Mounting, own: Identified) -> dict[str, Any]:
    serial = own.identity[SERIAL]
    change: dict[str, Any] = {}
    if own.node_id != mounting.node_id:
        change["node_id"] = own.node_id
    if serial and serial != mounting.serial:
        change["serial"] = serial
    if abs(math.remainder(own.yaw - mounting.yaw, math.tau)) > 1e-6:
        change["yaw_deg"] = round(math.degrees(own.yaw), 3)
    if own.mirrored != mounting.is_mirrored:
        change["mirrored"] = True if own.mirrored else None
    return change


def _eds_of(own: Identified, mountings: Sequence[Mounting], new_numbers: frozenset[int]) -> str | None:
    """Return the file that describes a board, if the arm file names one for it."""
    serial = own.identity[SERIAL]
    for mounting in mountings:
        if serial and mounting.serial == serial:
            return mounting.eds
    if own.node_id in new_numbers:
        return None
    return next((m.eds for m in mountings if m.node_id == own.node_id and m.serial == 0), None)
