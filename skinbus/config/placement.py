"""Where each patch of an arm file is; those on a mesh are laid where boards are known, in ``mesh_links``."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from skinbus.config.arm_tables import MAX_NAME, MAX_PATCH_ID, LinkTable, PatchTable, RingTable
from skinbus.errors import Fault, FaultList
from skinbus.printable import printable

Named = Mapping[str, tuple[int, LinkTable]]
"""Links without faults and their numbers, by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mounting:
    """One patch as the file places it, in SI units."""

    key: str
    """Where the file says so, for messages."""
    node_id: int
    link: int
    s: float
    a: float
    yaw: float
    eds: str
    settings: Mapping[str, Any]
    serial: int = 0
    address: str | None = None
    bus: int = 0
    is_mirrored: bool = False
    point: tuple[float, ...] | None = None
    """Of its centre on a mesh, m."""
    along: tuple[float, ...] | None = None
    """Direction of u there."""


def mount(
    patches: Sequence[tuple[str, PatchTable]],
    rings: Sequence[tuple[str, RingTable]],
    named: Named,
    known: Sequence[Any],
    faults: FaultList,
) -> list[Mounting]:
    """Return single patches, then the patches of rings, in the order of the file.

    known: names of all links, of those with faults too
    """
    for key, table in (*patches, *rings):
        if table.link not in known:  # a link that has faults of its own is reported there
            names = ", ".join(printable(str(n), limit=MAX_NAME) for n in known) or "none"
            faults.add(f"{key}.link", table.link, f"the name of a link: {names}")
    boards = [*patches]
    for key, ring in rings:
        boards += _boards(key, ring, named, faults)
    mountings = []
    for key, patch in boards:
        if patch.link in named:
            number, link = named[patch.link]
            faults += _patch_faults(key, patch, link)
            mountings.append(_patch(key, patch, number, link))
    return mountings


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


def _patch(key: str, patch: PatchTable, number: int, link: LinkTable) -> Mounting:
    a = 1e-3 * (patch.a_mm or 0.0)
    if "angle_deg" in link.places:
        a = _around(link, patch.angle_deg or 0.0)
    return Mounting(
        key=key,
        node_id=patch.node_id,
        link=number,
        s=1e-3 * (patch.s_mm or 0.0),
        a=a,
        yaw=math.radians(patch.yaw_deg),
        eds=patch.eds,
        settings=patch.set,
        serial=patch.serial,
        address=patch.address,
        is_mirrored=patch.mirrored,
        point=None if patch.xyz_mm is None else tuple(1e-3 * x for x in patch.xyz_mm),
        along=tuple(patch.along or (1.0, 0.0, 0.0)),
    )


def _around(link: LinkTable, angle_deg: float) -> float:
    """Return the chart coordinate a (m) of an angle on a closed surface."""
    surface = link.build()
    return float(surface.wrap(math.radians(angle_deg) * surface.radius))
