"""Where each patch of an arm file is; those on a mesh are laid where boards are known, in ``mesh_links``."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from skinbus.config.arm_tables import MAX_NAME, MAX_PATCH_ID, LinkTable, PatchTable, RingTable
from skinbus.errors import Fault, FaultList
from skinbus.model.surface import Surface
from skinbus.printable import printable

Named = Mapping[str, tuple[int, LinkTable]]
"""Links without faults and their numbers, by name."""


class Mounting(NamedTuple):
    """One patch as the file places it."""

    key: str
    """Where the file says so, for messages."""
    board: PatchTable
    link: int
    bus: int


def keys_of(surface: Surface, s: float, a: float) -> dict[str, float]:
    """Return a place by the keys of an arm file: along in mm, and around in degrees or across in mm."""
    around = {"angle_deg": math.degrees(a / surface.radius)} if surface.period else {"a_mm": 1e3 * a}
    return {"s_mm": 1e3 * s, **around}


def mount(
    patches: Sequence[tuple[str, PatchTable]],
    rings: Sequence[tuple[str, RingTable]],
    named: Named,
    links: Sequence[Any],
    buses: Sequence[Any],
    faults: FaultList,
) -> list[Mounting]:
    """Return single patches, then those of rings, as the file has them; those of the first bus come first.

    links, buses: names of all, of those with faults too
    """
    no_bus = f"the name of a bus: {_listed(buses)}" if buses else "no such key: there is no [[bus]]"
    for key, table in (*patches, *rings):
        if table.link not in links:  # a link that has faults of its own is reported there
            faults.add(f"{key}.link", table.link, f"the name of a link: {_listed(links)}")
        if table.bus not in (buses if len(buses) > 1 else [None, *buses]):
            faults.add(f"{key}.bus", table.bus, no_bus)
    boards = [*patches]
    for key, ring in rings:
        boards += _boards(key, ring, named, faults)
    mountings = []
    for key, board in boards:
        if board.link in named:
            number, link = named[board.link]
            faults += _patch_faults(key, board, link)
            bus = buses.index(board.bus) if board.bus in buses else 0
            mountings.append(Mounting(key, board, number, bus))
    return sorted(mountings, key=lambda mounting: mounting.bus)


def _listed(names: Sequence[Any]) -> str:
    return ", ".join(printable(str(name), limit=MAX_NAME) for name in names) or "none"


def _boards(key: str, ring: RingTable, named: Named, faults: FaultList) -> Iterator[tuple[str, PatchTable]]:
    """Yield the patches of a ring and their keys; none of one that has faults."""
    last = ring.first_node_id + ring.count - 1
    if last > MAX_PATCH_ID:
        faults.add(f"{key}.count", ring.count, f"node-IDs up to {MAX_PATCH_ID}, not {last}")
    elif ring.link in named and "angle_deg" not in named[ring.link][1].places:
        faults.add(f"{key}.link", ring.link, "a cylinder or cone: a ring goes around")
    elif isinstance(ring.eds, list) and len(ring.eds) != ring.count:
        wanted = f"one, or {ring.count}: one for each patch"
        faults.add(f"{key}.eds", f"{len(ring.eds)} files", wanted)
    else:
        yield from ((f"{key}#{k}", patch) for k, patch in enumerate(ring.boards(), 1))


def _patch_faults(key: str, patch: PatchTable, kind: LinkTable) -> Iterator[Fault]:
    """Yield what is wrong with the keys that place a patch on a kind of link."""
    for name in ("s_mm", "a_mm", "angle_deg", "yaw_deg", "xyz_mm", "along"):
        if name in patch.model_fields_set and name not in kind.places:
            wanted = f"no such key on a {kind.kind}, which has {', '.join(kind.places)}"
            yield Fault(f"{key}.{name}", getattr(patch, name), wanted)
    needed, what = (
        ("s_mm", "a place along the link") if "s_mm" in kind.places else ("xyz_mm", "a point of the mesh")
    )
    if getattr(patch, needed) is None:
        yield Fault(f"{key}.{needed}", None, what)
