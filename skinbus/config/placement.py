"""Links and patches of an arm file as its tables describe them: shapes, and where each patch is.

Patches on a mesh are laid where the boards are known, in ``config.mesh_links``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from skinbus.config.arm_tables import MAX_NAME, MAX_PATCH_ID, LinkTable, PatchTable, RingTable
from skinbus.errors import Fault
from skinbus.printable import printable

MAX_LINKS: Final = 16
"""A contact's TPDO has four bits for its link."""


_SHAPE: Final[dict[str, tuple[str, ...]]] = {
    "plane": ("length_mm", "width_mm"),
    "cylinder": ("length_mm", "radius_mm"),
    "cone": ("length_mm", "radius_near_mm", "radius_far_mm"),
    "mesh": ("mesh", "unit_mm"),
}
_SIZES: Final = ("length_mm", "width_mm", "radius_mm", "radius_near_mm", "radius_far_mm", "mesh", "unit_mm")


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
    bus: int = 0
    is_mirrored: bool = False
    point: tuple[float, ...] | None = None
    """Of its centre on a mesh, m."""
    along: tuple[float, ...] | None = None
    """Direction of u there."""
    tactels: str | None = None
    """File with the places of its tactels on a mesh."""


def check_links(links: list[tuple[str, LinkTable]], faults: list[Fault]) -> None:
    """Add the faults of the shapes and names of links."""
    seen: dict[str, str] = {}
    if len(links) > MAX_LINKS:
        faults.append(Fault("link", f"{len(links)} links", f"at most {MAX_LINKS}"))
    for key, link in links:
        if link.name in seen:
            faults.append(Fault(f"{key}.name", link.name, f"a name other than that of {seen[link.name]}"))
        seen.setdefault(link.name, key)
        needed = _SHAPE[link.surface]
        for name in _SIZES:
            value = getattr(link, name)
            if name in needed and value is None and name != "unit_mm":
                what = "a file" if name == "mesh" else "a length"
                faults.append(Fault(f"{key}.{name}", None, f"{what}: a {link.surface} needs it"))
            elif name not in needed and value is not None:
                faults.append(
                    Fault(f"{key}.{name}", value, f"no such key: a {link.surface} has {', '.join(needed)}")
                )
        if _whole(link) and not link.can_be_built:
            change = abs((link.radius_far_mm or 0.0) - (link.radius_near_mm or 0.0))
            faults.append(
                Fault(f"{key}.length_mm", link.length_mm, f"more than {change:g}, the change of radius")
            )


def mount(
    patches: list[tuple[str, PatchTable]],
    rings: list[tuple[str, RingTable]],
    named: dict[str, tuple[int, LinkTable]],
    written: list[Any],
    faults: list[Fault],
) -> list[Mounting]:
    """Return single patches, then the patches of rings, in the order of the file."""
    mountings = []

    def find(key: str, name: str) -> tuple[int, LinkTable] | None:
        if name not in written:  # a link that has faults of its own is reported there
            known = ", ".join(printable(n, limit=MAX_NAME) for n in written) or "none"
            faults.append(Fault(f"{key}.link", name, f"the name of a link: {known}"))
        return named.get(name)

    for key, patch in patches:
        link = find(key, patch.link)
        if link is None:
            continue
        a = 0.0
        if link[1].surface == "mesh":
            _check_on_mesh(key, patch, faults)
        else:
            a = _across(key, patch, link[1], faults)
        mountings.append(_mounting(key, patch, link[0], patch.node_id, a, patch.eds, patch.serial))
    for key, ring in rings:
        link = find(key, ring.link)
        if ring.first_node_id + ring.count - 1 > MAX_PATCH_ID:
            last = ring.first_node_id + ring.count - 1
            faults.append(Fault(f"{key}.count", ring.count, f"node-IDs up to {MAX_PATCH_ID}, not {last}"))
            continue
        if link is None:
            continue
        if link[1].surface in ("plane", "mesh"):
            faults.append(Fault(f"{key}.link", ring.link, "a cylinder or cone: a ring goes around"))
            continue
        files = ring.eds if isinstance(ring.eds, list) else [ring.eds] * ring.count
        if len(files) != ring.count:
            faults.append(
                Fault(f"{key}.eds", f"{len(files)} files", f"one, or {ring.count}: one for each patch")
            )
            continue
        around = _around(link[1])
        for k in range(ring.count):
            a = around(ring.angle_deg + 360.0 * k / ring.count)
            mountings.append(_mounting(f"{key}#{k + 1}", ring, link[0], ring.first_node_id + k, a, files[k]))
    return mountings


def _mounting(
    key: str, table: PatchTable | RingTable, link: int, node_id: int, a: float, eds: str, serial: int = 0
) -> Mounting:
    point = along = tactels = None
    if isinstance(table, PatchTable):
        tactels = table.tactels
        if table.xyz_mm is not None:
            point = tuple(1e-3 * x for x in table.xyz_mm)
            along = tuple(table.along or (1.0, 0.0, 0.0))
    return Mounting(
        key=key,
        node_id=node_id,
        link=link,
        s=1e-3 * (table.s_mm or 0.0),
        a=a,
        yaw=math.radians(table.yaw_deg),
        eds=eds,
        settings=table.set,
        serial=serial,
        is_mirrored=table.mirrored,
        point=point,
        along=along,
        tactels=tactels,
    )


def _check_on_mesh(key: str, patch: PatchTable, faults: list[Fault]) -> None:
    """A board on a mesh has a point and a direction, or the places of its tactels."""
    for name in ("s_mm", "a_mm", "angle_deg"):
        if getattr(patch, name) is not None:
            faults.append(Fault(f"{key}.{name}", getattr(patch, name), "no such key on a mesh: use xyz_mm"))
    if patch.yaw_deg:
        faults.append(Fault(f"{key}.yaw_deg", patch.yaw_deg, "no such key on a mesh: use along"))
    if patch.xyz_mm is None and patch.tactels is None:
        faults.append(Fault(f"{key}.xyz_mm", None, "a point of the mesh, or tactels"))
    for name in ("xyz_mm", "along"):
        if patch.tactels is not None and getattr(patch, name) is not None:
            faults.append(Fault(f"{key}.{name}", getattr(patch, name), "nothing beside tactels"))


_PLACED: Final = [True, False, False, False, False]
"""Of the keys of a place on a link that is no mesh: only s_mm has to be there."""


def _across(key: str, patch: PatchTable, link: LinkTable, faults: list[Fault]) -> float:
    """Return the chart coordinate a of a single patch, m, on a link that is no mesh; NaN with faults."""
    wrong = "angle_deg" if link.surface == "plane" else "a_mm"
    said = [getattr(patch, name) is not None for name in ("s_mm", "xyz_mm", "along", "tactels", wrong)]
    if patch.s_mm is None:
        faults.append(Fault(f"{key}.s_mm", None, "a place along the link"))
    for name in ("xyz_mm", "along", "tactels"):
        if getattr(patch, name) is not None:
            faults.append(Fault(f"{key}.{name}", getattr(patch, name), f"no such key on a {link.surface}"))
    if link.surface == "plane":
        if patch.angle_deg is not None:
            faults.append(Fault(f"{key}.angle_deg", patch.angle_deg, "no such key on a plane: use a_mm"))
        return 1e-3 * (patch.a_mm or 0.0) if said == _PLACED and _whole(link) else math.nan
    if patch.a_mm is not None:
        faults.append(Fault(f"{key}.a_mm", patch.a_mm, f"no such key on a {link.surface}: use angle_deg"))
    return _around(link)(patch.angle_deg or 0.0) if said == _PLACED else math.nan


def _whole(link: LinkTable) -> bool:
    return all(getattr(link, name) is not None for name in _SHAPE[link.surface])


def _around(link: LinkTable) -> Callable[[float], float]:
    """Return the map from an angle (degrees) to the chart coordinate a (m) of a closed surface, or to NaN."""
    if not (_whole(link) and link.can_be_built):  # reported already
        return lambda angle_deg: math.nan
    surface = link.build()
    return lambda angle_deg: float(surface.wrap(math.radians(angle_deg) * surface.radius))
