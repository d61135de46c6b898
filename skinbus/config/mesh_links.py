"""Links of an arm file with their surfaces; boards are laid onto those that are meshes.

What lays them is loaded only by a file with a mesh.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from skinbus.config.arm_file import ArmFile
from skinbus.config.arm_tables import MeshTable, beside
from skinbus.config.placement import Mounting
from skinbus.errors import ConfigError, Fault, FaultList
from skinbus.file_bytes import read_bytes
from skinbus.model import Link, PlacedPatch

if TYPE_CHECKING:
    from skinbus.robot.mesh import Mesh
    from skinbus.robot.mesh_link import Laid

Floats = npt.NDArray[np.float64]

_PLACE: Final = ("x_mm", "y_mm", "z_mm")
_MAX_BYTES: Final = 100_000
"""Of a file of tactels: 64 lines of any usual length, a hundred times over."""


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
        from skinbus.robot.mesh_link import cache_folder, lay

        key, mesh_file = f"link[{k + 1}]", beside(table.mesh, file.path)
        own = [p for p, patch in enumerate(placed) if patch.link == k]
        boards = [_board(file.mountings[p], placed[p], file.path, faults) for p in own]
        try:
            which = mesh_file, 1e-3 * table.unit_mm
            mesh = read[which] if which in read else read.setdefault(which, load_mesh(*which))
            if not own:
                raise ConfigError(str(mesh_file), [Fault("boards", 0, "at least one on a mesh")])
            laid = [board for board in boards if board is not None]
            if len(laid) < len(own):
                continue
            surface, rows = lay(mesh, laid, str(mesh_file), cache_folder())
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


def _board(mounting: Mounting, placed: PlacedPatch, arm_file: Path, faults: list[Fault]) -> Laid | None:
    """Return a board as it is to be laid, or None and its faults."""
    from skinbus.robot.mesh_link import Laid

    uv = np.asarray(placed.patch.tactels_uv)
    if mounting.point is not None:
        point, along = np.array(mounting.point), np.array(mounting.along)
        return Laid(key=mounting.key, uv=uv, point=point, along=along)
    assert mounting.tactels is not None  # the file was checked
    read = _read_tactels(beside(mounting.tactels, arm_file), mounting.key, len(uv), faults)
    return None if read is None else Laid(key=mounting.key, uv=uv, places=read)


def _read_tactels(path: Path, key: str, n: int, faults: list[Fault]) -> Floats | None:
    """Return the places (n, 3) m of the tactels of a board, or None; add faults."""
    where, wrong = f"{key}.tactels {path}", FaultList()
    try:
        text = read_bytes(path, _MAX_BYTES).decode("utf-8")
    except ConfigError as error:
        faults += [Fault(where, fault.seen, fault.wanted) for fault in error.faults]
        return None
    except UnicodeDecodeError:
        faults.append(Fault(where, None, "UTF-8 text"))
        return None
    names, *rows = [row for row in csv.reader(text.splitlines()) if row] or [[]]
    if tuple(name.strip() for name in names[:3]) != _PLACE:
        wrong.append(Fault(f"{where} line 1", ",".join(names) or None, f"columns {','.join(_PLACE)} first"))
    places = np.full((len(rows), 3), np.nan)
    for k, row in enumerate(rows):
        with suppress(ValueError):
            places[k] = [float(cell) for cell in row[:3]]
        if not np.isfinite(places[k]).all():
            wrong.append(Fault(f"{where} row {k + 1}", ",".join(row), "three numbers first"))
    if len(places) != n:
        wrong.append(Fault(where, f"{len(places)} tactels", f"{n}, as the EDS of the board has"))
    faults += wrong
    return None if wrong else 1e-3 * places
