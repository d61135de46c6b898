"""The 3-D scene in viser: nodes made once, of which a drawing changes colours and points only.

Nothing is added or removed while it runs: what viser keeps for new pages stays of one size. Meshes are
float32 in the frame of a link, m; faces are counter-clockwise seen from outside.
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import numpy.typing as npt
import viser
import viser.transforms
from scipy.spatial import Delaunay
from trimesh import Trimesh
from trimesh.convex import convex_hull

from skinbus.arrays import Floats
from skinbus.model import Arm, Surface, grid
from skinbus.model.mesh_surface import MeshSurface
from skinbus.view.web import colours
from skinbus.view.web.drawing import Drawing, Lines
from skinbus.view.web.poses import Poses, placed

Mesh = tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32]]
"""Vertices (n, 3) m, faces (m, 3)."""

UNDER = 1.5e-3
"""Depth of the drawn link under its surface, m: more than facets are off, so that boards stay in front."""
ROUND = 64
"""Facets of a round link: on a radius of 80 mm they are 0.1 mm inside of it."""
BOARD_EDGE = 5
"""Points along an edge of a board, 12.5 mm apart: on a radius of 40 mm a facet is 0.5 mm off, below OVER."""
OVER = 0.8e-3
"""Height of a tactel over its board, m: a flat disc of 9.5 mm on a radius of 40 mm bends away by 0.3 mm."""
RIM = 16
"""Corners of a disc."""
N_LABELS = 24
"""Labels of contacts: more are not read."""
ARROW: dict[str, Any] = {"shaft_radius": 0.0014, "head_radius": 0.0036, "head_length": 0.009}
TRUE_ARROW: dict[str, Any] = {"shaft_radius": 0.0009, "head_radius": 0.0025, "head_length": 0.007}
VIEW = np.array([0.4, -1.05, 0.85])
"""Where the camera is, in sizes of the arm from its middle: from the side and above."""
ASPECT = 1.05
"""Width by height of a page on which the arm fills the width from there."""
LIT = 1.1 * colours.LIGHT
"""Light on a surface that faces the camera, about."""
FILL = colours.LIGHT * np.pi
"""Intensity of the ambient light: most of the light is the same for all directions, as colours are read."""
SUN = 0.15 * FILL
"""Of the light from above, which shows the shape."""
PLAIN: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}
LINES = {"boards": 3.0, "ellipses": 2.5, "truths": 2.5}
"""Lines of a drawing, and their thickness in pixels."""
BONES = 12.0
"""Pixels, of the lines from joint to joint that are drawn of a robot; its shapes hide them."""


class SceneNodes:
    """The nodes of an arm in a viser server."""

    def __init__(self, server: viser.ViserServer, arm: Arm, poses: Poses) -> None:
        self._server, self._arm, self._poses = server, arm, poses
        scene = server.scene
        scene.set_up_direction("+z")
        scene.configure_environment_map(hdri=None)
        scene.configure_default_lights(enabled=False)
        scene.add_light_ambient("/light/fill", intensity=FILL)
        scene.add_light_directional("/light/sun", intensity=SUN, position=(0.4, -0.8, 1.0))
        self._links = [scene.add_frame(f"/link {k}", show_axes=False) for k in range(len(arm.links))]
        self._bodies = [link_mesh(link.surface) for link in arm.links]
        self._tactels = [self._add_link(k) for k in range(len(arm.links))]
        self._lines = {name: self._add_lines(name, thickness) for name, thickness in LINES.items()}
        self._arrows: dict[str, Any] = {
            name: scene.add_arrows(
                f"/{name}", np.zeros((1, 2, 3)), np.zeros((1, 3), np.uint8), visible=False, **size
            )
            for name, size in (("forces", ARROW), ("true_forces", TRUE_ARROW))
        }
        self._labels = [
            scene.add_label(f"/label {n}", "", visible=False, anchor="bottom-center", depth_test=True)
            for n in range(N_LABELS)
        ]
        self.note = ""
        """What of the robot is not drawn, for people; empty for nothing."""
        self._bones = self._add_lines("bones", BONES)
        self._bones.visible = bool(len(poses.bones))
        self._robot = self._add_robot()
        self.move()
        camera: Any = server.initial_camera
        camera.up, camera.fov = (0.0, 0.0, 1.0), 0.8
        self._aim(camera, ASPECT)
        server.on_client_connect(self._watch)

    def _add_link(self, k: int) -> Any:
        """Add a link with its boards; return the node of its tactels."""
        scene, arm, name = self._server.scene, self._arm, f"/link {k}"
        side: Any = "double" if isinstance(arm.links[k].surface, MeshSurface) else "front"
        body = colours.for_mesh(colours.BODY)
        scene.add_mesh_simple(f"{name}/body", *self._bodies[k], color=body, side=side, **PLAIN)
        here = arm.tactel_link == k
        if not here.any():
            return None
        board = colours.for_mesh(colours.BOARD)
        scene.add_mesh_simple(f"{name}/boards", *board_meshes(arm, k), color=board, side="front", **PLAIN)
        points, normals = arm.links[k].surface.position(arm.tactel_s[here], arm.tactel_a[here])
        diameters = np.array([placed.patch.diameter for placed in arm.patches])[arm.tactel_patch[here]]
        return scene.add_batched_meshes_simple(
            f"{name}/tactels",
            *unit_disc(RIM),
            quaternions(normals),
            (points + OVER * normals).astype(np.float32),
            batched_scales=(0.5 * diameters).astype(np.float32),
            batched_colors=np.tile(colours.for_instances(colours.UNKNOWN, LIT), (len(points), 1)),
            lod="off",
            side="front",
            **PLAIN,
        )

    def _add_lines(self, name: str, thickness: float) -> Any:
        return self._server.scene.add_line_segments(
            f"/{name}",
            np.zeros((1, 2, 3)),
            np.zeros((1, 2, 3), np.uint8),
            thickness=thickness,
            thickness_units="screen",
            visible=False,
        )

    def _add_robot(self) -> Any:
        """Add the links of the robot as its URDF shows them, as far as its meshes can be read."""
        if self._arm.robot is None:
            return None
        from viser.extras import ViserUrdf
        from yourdfpy import URDF

        logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)  # it warns of each mesh that is not there
        try:
            urdf = URDF.load(self._arm.robot.urdf)
            base = self._arm.robot.base or urdf.base_link
            X_BR = np.linalg.inv(urdf.get_transform(base, urdf.base_link))
            self._place(self._server.scene.add_frame("/robot", show_axes=False), X_BR)
            body = colours.for_mesh(colours.ROBOT)
            robot = ViserUrdf(self._server, urdf, root_node_name="/robot", mesh_color_override=body)
        except Exception as error:  # noqa: BLE001 - whatever a file of meshes has in it: the skin is shown without
            self.note = f"the robot is drawn as lines: {type(error).__name__}: {error}"
            return None
        n = sum(len(link.visuals) for link in urdf.robot.links)
        if missing := n - len(urdf.scene.geometry):
            self.note = (
                f"{missing} of {n} shapes of the URDF are not found: the robot is drawn as lines there"
            )
        return robot

    def _place(self, node: Any, X: Floats) -> None:
        node.wxyz, node.position = viser.transforms.SO3.from_matrix(X[:3, :3]).wxyz, X[:3, 3]

    def move(self) -> None:
        """Put the links where the poses have them."""
        for node, X in zip(self._links, self._poses.X_BS, strict=True):
            self._place(node, X)
        if self._bones.visible:
            self._bones.points = self._poses.bones.astype(np.float32)
            grey = colours.for_instances(colours.ROBOT)
            self._bones.colors = np.tile(grey, (len(self._poses.bones), 2, 1))
        if self._robot is not None:
            self._robot.update_cfg(self._poses.joints)

    def show(self, drawing: Drawing) -> None:
        """Draw a cycle."""
        for node, tints in zip(self._tactels, drawing.tactels, strict=True):
            if node is not None:
                node.batched_colors = colours.for_instances(tints, LIT)
        for name, node in (self._lines | self._arrows).items():
            lines: Lines = getattr(drawing, name)
            node.visible = bool(len(lines.points))
            if node.visible:  # nodes of viser are never empty
                light = LIT if name in self._arrows else 1.0
                node.points = lines.points.astype(np.float32)
                node.colors = colours.for_instances(lines.colours, light)
        for n, label in enumerate(self._labels):
            label.visible = n < len(drawing.labels)
            if label.visible:
                label.position, label.text = drawing.labels[n]

    def aim(self) -> None:
        """Point the cameras at the whole arm as it stands."""
        self._aim(self._server.initial_camera, ASPECT)
        for client in self._server.get_clients().values():
            self._aim(client.camera, client.camera.aspect)

    async def _watch(self, client: viser.ClientHandle) -> None:
        """Show a page that is opened the arm as it stands now, also once its layout is known."""
        aspect = client.camera.aspect
        begin = self._aim(client.camera, aspect)

        async def fit(seen: viser.CameraHandle) -> None:
            nonlocal aspect, begin
            if seen.aspect != aspect and np.allclose(seen.position, begin, atol=1e-3):
                aspect = seen.aspect
                begin = self._aim(seen, aspect)

        client.camera.on_update(fit)

    def _aim(self, camera: Any, aspect: float) -> Floats:
        """Point a camera at the whole arm, on a phone from farther away; return where it is."""
        corners = [placed(X, mesh[0]) for X, mesh in zip(self._poses.X_BS, self._bodies, strict=True)]
        points = np.concatenate([*corners, self._poses.bones.reshape(-1, 3)])
        low, high = points.min(0), points.max(0)
        middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
        camera.near = 0.01 * size
        position = np.asarray(middle + size * VIEW * max(1.0, ASPECT / aspect))
        camera.position, camera.look_at = position, middle
        return position


def link_mesh(surface: Surface) -> Mesh:
    """Return the body of a link, a little under its surface; closed surfaces get caps."""
    if isinstance(surface, MeshSurface):
        normals = Trimesh(surface.points, surface.triangles, process=False).vertex_normals
        return _mesh(surface.points - UNDER * normals, surface.triangles)
    around = (
        np.arange(ROUND) * surface.period / ROUND if surface.period else np.array([-0.5, 0.5]) * surface.width
    )
    s, a = np.meshgrid([0.0, surface.length], around)
    points, normals = surface.position(s.ravel(), a.ravel())
    depths = [UNDER] if surface.period else [UNDER, 4.0 * UNDER]
    hull = convex_hull(np.concatenate([points - depth * normals for depth in depths]))
    return _mesh(hull.vertices, hull.faces)


def board_meshes(arm: Arm, link: int) -> Mesh:
    """Return the boards of a link, bent to its surface, as one mesh."""
    shares = grid(BOARD_EDGE, BOARD_EDGE, 1.0 / (BOARD_EDGE - 1))
    faces = Delaunay(shares).simplices
    surface = arm.links[link].surface
    boards = [board for board in arm.patches if board.link == link]
    vertices = [surface.position(*b.on_link(surface, np.array(b.patch.size) * shares))[0] for b in boards]
    starts = len(shares) * np.arange(len(boards))[:, None, None]
    return _mesh(np.concatenate(vertices), (faces + starts).reshape(-1, 3))


def unit_disc(n: int) -> Mesh:
    """Return a disc of n corners about z, facing +z, of radius 1."""
    rim, k = np.exp(2j * np.pi * np.arange(n) / n), np.arange(1, n - 1)
    return _mesh(np.stack([rim.real, rim.imag, 0.0 * rim.real], -1), np.stack([0 * k, k, k + 1], -1))


def quaternions(normals: Floats) -> npt.NDArray[np.float32]:
    """Return unit quaternions (n, 4) that turn z to unit vectors (n, 3) by the shortest way."""
    x, y, z = normals.T
    q = np.stack([1.0 + z, -y, x, np.zeros_like(z)], -1)
    q[z < -1.0 + 1e-9] = (0.0, 1.0, 0.0, 0.0)
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True), np.float32)


def _mesh(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> Mesh:
    return np.asarray(vertices, np.float32), np.asarray(faces, np.uint32)
