"""Arms whose link is a mesh, beside those of the shapes that the meshes are of."""

from dataclasses import replace
from functools import cache

import numpy as np

from skinbus.model import Arm, Cone, Link, Patch, PlacedPatch, Surface, grid
from skinbus.robot.mesh import mend
from skinbus.robot.mesh_link import Laid, lay
from tests.files import put
from tests.robot.meshes import tube

TUBE_ARM = """
[arm]
name = "tube"
[[link]]
name = "tube"
surface = "mesh"
mesh = "tube.stl"
unit_mm = 10
[[patch]]
node_id = 1
link = "tube"
xyz_mm = [70.0, 0.0, 40.0]
[[patch]]
node_id = 2
link = "tube"
xyz_mm = [70.0, 40.0, 0.0]
along = [0.0, 0.0, 1.0]
"""


RADIUS, LENGTH, ROWS, AROUND = 0.05, 0.2, 2, 6


@cache
def tube_arms():
    """A cylinder with rings of boards, and its mesh with the same boards."""
    patch, surface = Patch(tactels_uv=grid(4, 4, 0.010), law=Cone()), Surface.cylinder(LENGTH, RADIUS)
    boards, laid = [], []
    for k in range(ROWS * AROUND):
        row, column = divmod(k, AROUND)
        s = 0.5 * LENGTH + 0.051 * (row - 0.5 * (ROWS - 1))
        a = float(surface.wrap(column * surface.period / AROUND))
        boards.append(PlacedPatch(patch=patch, node_id=1 + k, link=0, s=s, a=a))
        point, _ = surface.position(s, a)
        along = np.array([1.0, 0.0, 0.0])
        laid.append(Laid(key=f"patch[{k + 1}]", uv=patch.tactels_uv, point=point, along=along))
    flat = Arm("cylinder", [Link("tube", surface)], boards)
    return flat, mesh_arm(mend(*tube(RADIUS, LENGTH, 3e-3)), laid, boards)


def mesh_arm(mesh, laid, boards):
    """An arm of one mesh with boards laid onto it."""
    surface, rows = lay(mesh, laid, "mesh")
    placed = [
        replace(board, s=row.s, a=row.a, yaw=row.yaw, on_chart=row.tactels)
        for board, row in zip(boards, rows, strict=True)
    ]
    return Arm("mesh", [Link("tube", surface)], placed)


def write_tube(folder, text=TUBE_ARM):
    """An arm file beside the mesh of a tube of 40 mm radius, in its units of 10 mm."""
    import trimesh

    points, triangles = tube(0.04, 0.14, 3e-3)
    trimesh.Trimesh(100.0 * points, triangles, process=False).export(folder / "tube.stl")
    return put(folder, "arm.toml", text)
