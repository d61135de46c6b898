"""Links of an arm file with their surfaces; boards are laid onto those that are meshes.

What lays them is loaded only by a file with a mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from skinbus.config.arm_file import ArmFile
from skinbus.config.arm_tables import MeshTable, beside
from skinbus.errors import ConfigError, Fault
from skinbus.file_bytes import cache_home
from skinbus.model import Link, PlacedPatch

if TYPE_CHECKING:
    from skinbus.robot.mesh import Mesh


def lay_links(
    file: ArmFile, placed: Sequence[PlacedPatch], faults: list[Fault]
) -> tuple[list[Link], list[PlacedPatch]]:
    """Return the links of a file and its patches, those on meshes laid onto them; add faults.

    Raises:
        SkinbusError: there is a mesh, and trimesh or potpourri3d is not installed.
    """
    links, patches = [], list(placed)
    read: dict[tuple[Path, float], Mesh] = {}  # covers that are alike share one file
    for k, table in enumerate(file.links):
        if not isinstance(table, MeshTable):
            links.append(Link(table.name, table.build()))
            continue
        from skinbus.robot.mesh import load_mesh
        from skinbus.robot.mesh_link import Laid, lay

        key, mesh_file = f"link[{k + 1}]", beside(table.mesh, file.path)
        own = [p for p, patch in enumerate(placed) if patch.link == k]
        boards = [
            Laid(
                key=placed[p].key,
                uv=np.asarray(placed[p].patch.tactels_uv),
                point=1e-3 * np.array(file.mountings[p].board.xyz_mm),
                along=np.array(file.mountings[p].board.along or (1.0, 0.0, 0.0)),
            )
            for p in own
        ]
        try:
            which = mesh_file, 1e-3 * table.unit_mm
            mesh = read[which] if which in read else read.setdefault(which, load_mesh(*which))
            if not own:
                raise ConfigError.of(mesh_file, "boards", 0, "at least one on a mesh")
            surface, rows = lay(mesh, boards, str(mesh_file), cache_home() / "charts")
        except ConfigError as error:
            faults += [_at(key, mesh_file, fault) for fault in error.faults]
            continue
        links.append(Link(table.name, surface))
        for p, row in zip(own, rows, strict=True):
            patches[p] = replace(placed[p], s=row.s, a=row.a, yaw=row.yaw, on_chart=row.tactels)
    return links, patches


def _at(key: str, mesh_file: Path, fault: Fault) -> Fault:
    """Return a fault of a mesh as one of the arm file; those of boards have their own key."""
    if fault.key.startswith(("patch[", "ring[")):
        return fault
    return Fault(f"{key}.mesh {mesh_file} {fault.key}", fault.seen, fault.wanted)
