"""The 3-D scene in viser: nodes made once, of which a drawing changes colours and points only.

Nothing is added or removed while it runs: what viser keeps for new pages stays of one size.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import viser
import viser.transforms

from skinbus.model import Arm
from skinbus.model.mesh_surface import MeshSurface
from skinbus.view.web import colours
from skinbus.view.web.drawing import Arrows, Drawing, Label, Lines
from skinbus.view.web.poses import Poses, placed
from skinbus.view.web.solids import board_meshes, link_mesh
from skinbus.view.web.tactels import LIT, NO_SHADOW, add_tactels

BLIND_SIZE: Final = 0.0025
"""Of a point of a blind area, m; they are 4 mm apart."""
N_LABELS: Final = 24
"""Labels of contacts, and of loads: more are not read."""
ARROW: Final[dict[str, Any]] = {"shaft_radius": 0.0014, "head_radius": 0.0036, "head_length": 0.009}
TRUE_ARROW: Final[dict[str, Any]] = {"shaft_radius": 0.0009, "head_radius": 0.0025, "head_length": 0.007}
VIEW: Final = np.array([0.4, -1.05, 0.85])
"""Where the camera is, in sizes of the arm from its middle: from the side and above."""
ASPECT: Final = 1.05
"""Width by height of a page on which the arm fills the width from there."""
FILL: Final = colours.LIGHT * np.pi
"""Intensity of the ambient light: most of the light is the same for all directions, as colours are read."""
SUN: Final = 0.15 * FILL
"""Of the light from above, which shows the shape."""


class StageNodes:
    """The nodes of an arm in a viser server."""

    def __init__(self, server: viser.ViserServer, arm: Arm, poses: Poses) -> None:
        self._server = server
        scene = server.scene
        scene.set_up_direction("+z")
        scene.configure_environment_map(hdri=None)
        scene.configure_default_lights(enabled=False)
        scene.add_light_ambient("/light/fill", intensity=FILL)
        scene.add_light_directional("/light/sun", intensity=SUN, position=(0.4, -0.8, 1.0))
        self._links: list[Any] = []
        for k, link in enumerate(arm.links):
            name = f"/link {k}"
            self._links.append(scene.add_frame(name, show_axes=False))
            body, boards = link_mesh(link.surface), board_meshes(arm, k)
            scene.add_mesh_simple(
                f"{name}/body",
                body.vertices,
                body.faces,
                color=colours.for_mesh(colours.BODY),
                side="double" if isinstance(link.surface, MeshSurface) else "front",
                **NO_SHADOW,
            )
            if not len(boards.faces):
                continue
            scene.add_mesh_simple(
                f"{name}/boards",
                boards.vertices,
                boards.faces,
                color=colours.for_mesh(colours.BOARD),
                side="front",
                **NO_SHADOW,
            )
        self._tactels = add_tactels(scene, arm, poses)
        self._outlines = self._lines("outlines", 1.5)
        self._crosses = self._lines("crosses", 4.0)
        self._suspects = self._lines("suspects", 3.0)
        self._ellipses = self._lines("ellipses", 2.5)
        self._trails = self._lines("trails", 3.0)
        self._truths = self._lines("truths", 2.5)
        self._published = self._lines("published", 2.5)
        self._forces = self._arrows("forces", ARROW)
        self._true_forces = self._arrows("true forces", TRUE_ARROW)
        self._blind = scene.add_point_cloud(
            "/blind",
            np.zeros((1, 3), np.float32),
            np.zeros((1, 3), np.uint8),
            point_size=BLIND_SIZE,
            point_shape="square",
            point_shading="flat",
            precision="float32",
            visible=False,
        )
        self._labels, self._loads = (
            [
                scene.add_label(f"/{name} {n}", "", visible=False, anchor="bottom-center", depth_test=True)
                for n in range(N_LABELS)
            ]
            for name in ("label", "load")
        )
        self.move(poses)
        self._aim(arm, poses)

    def move(self, poses: Poses) -> None:
        """Put the links to other poses."""
        for node, X in zip(self._links, poses.X_BS, strict=True):
            node.wxyz = viser.transforms.SO3.from_matrix(X[:3, :3]).wxyz
            node.position = X[:3, 3]
        self._tactels.move(poses)

    def show(self, drawing: Drawing, *, labels: bool = True, trails: bool = True, truth: bool = True) -> None:
        """Draw a cycle."""
        self._tactels.show(drawing.tactels)
        _set_lines(self._outlines, drawing.outlines)
        _set_lines(self._crosses, drawing.crosses)
        _set_lines(self._suspects, drawing.suspects)
        _set_lines(self._ellipses, drawing.ellipses)
        _set_lines(self._trails, drawing.trails, trails)
        _set_lines(self._truths, drawing.truths, truth)
        _set_lines(self._published, drawing.published, truth)
        _set_arrows(self._forces, drawing.forces)
        _set_arrows(self._true_forces, drawing.true_forces, truth)
        _set_labels(self._labels, drawing.labels if labels else ())

    def show_loads(self, loads: Sequence[Label]) -> None:
        """Show the loads of boards."""
        _set_labels(self._loads, loads)

    def show_blind(self, points: npt.NDArray[np.float64]) -> None:
        """Show where the skin feels too little, points (n, 3) in the base; none hides them."""
        self._blind.visible = bool(len(points))
        if len(points):
            self._blind.points = points.astype(np.float32)
            self._blind.colors = np.tile(np.array(colours.BLIND, np.uint8), (len(points), 1))

    def _lines(self, name: str, thickness: float) -> Any:
        return self._server.scene.add_line_segments(
            f"/{name}",
            np.zeros((1, 2, 3)),
            np.zeros((1, 2, 3), np.uint8),
            thickness=thickness,
            thickness_units="screen",
            visible=False,
        )

    def _arrows(self, name: str, size: dict[str, Any]) -> Any:
        return self._server.scene.add_arrows(
            f"/{name}", np.zeros((1, 2, 3)), np.zeros((1, 3), np.uint8), visible=False, **size
        )

    def _aim(self, arm: Arm, poses: Poses) -> None:
        """Point the camera at the whole arm, from the side and above."""
        corners = np.concatenate(
            [
                placed(X, link_mesh(link.surface).vertices)
                for X, link in zip(poses.X_BS, arm.links, strict=True)
            ]
        )
        low, high = corners.min(0), corners.max(0)
        middle, away = 0.5 * (low + high), float(np.linalg.norm(high - low)) * VIEW
        camera = self._server.initial_camera
        camera.look_at = tuple(middle)
        camera.position = tuple(middle + away)
        camera.up = (0.0, 0.0, 1.0)
        camera.near = 0.01 * float(np.linalg.norm(away))
        camera.fov = 0.8

        def step_back(seen: viser.CameraHandle) -> None:
            """Show the whole arm on a phone: from farther away, while the camera is where it begins."""
            is_first = np.allclose(seen.position, middle + away, atol=1e-3 * float(np.linalg.norm(away)))
            if is_first and seen.aspect < ASPECT:
                seen.position = middle + away * ASPECT / seen.aspect
                seen.look_at = middle  # it has moved along

        @self._server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            client.camera.on_update(step_back)
            step_back(client.camera)


def _set_labels(nodes: Sequence[Any], labels: Sequence[Label]) -> None:
    for n, node in enumerate(nodes):
        if n < len(labels):
            node.text, node.position = labels[n].text, labels[n].point
        node.visible = n < len(labels)


def _set_lines(node: Any, lines: Lines, is_wanted: bool = True) -> None:
    """Show lines; nodes of viser are never empty, so that of no lines is hidden."""
    node.visible = bool(len(lines)) and is_wanted
    if node.visible:
        points = lines.points.astype(np.float32)
        if points.shape != node.points.shape or not np.array_equal(points, node.points):
            node.points = points
        node.colors = colours.for_instances(lines.colours)


def _set_arrows(node: Any, arrows: Arrows, is_wanted: bool = True) -> None:
    node.visible = bool(len(arrows.points)) and is_wanted
    if node.visible:
        node.points, node.colors = arrows.points, colours.for_instances(arrows.colours, LIT)
