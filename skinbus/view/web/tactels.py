"""Tactels in the 3-D scene: discs of any colour, or where there are many squares in a few shades.

Without a graphics card each disc of a batch costs as much as a drawing of its own, 20 us in SwiftShader,
however many corners it has. Squares of one shade are one drawing, and are sent when a tactel changes shade.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from skinbus.model import Arm
from skinbus.view.web import colours
from skinbus.view.web.colours import Colours
from skinbus.view.web.poses import Poses, placed
from skinbus.view.web.solids import tactel_discs, tactel_squares, unit_disc

MANY: Final = 400
"""Tactels beyond which they are squares: as discs they would take 8 ms of the 50 ms of a picture."""
N_SHADES: Final = 16
"""Of squares: of a map of 30 kPa 1.9 kPa each; twice as many take a picture a quarter longer."""
RIM: Final = 16
"""Corners of a disc."""
SQUARE: Final = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
LIT: Final = 1.1 * colours.LIGHT
"""Light on a surface that faces the camera, about."""
NO_SHADOW: Final[dict[str, Any]] = {"cast_shadow": False, "receive_shadow": False}


class DiscTactels:
    """A batch of discs for each link, in its frame ``/link N``."""

    def __init__(self, scene: Any, arm: Arm) -> None:
        disc = unit_disc(RIM)
        self._nodes: list[Any] = []
        for k in range(len(arm.links)):
            discs = tactel_discs(arm, k)
            n = len(discs.radius)
            node = n and scene.add_batched_meshes_simple(
                f"/link {k}/tactels",
                disc.vertices,
                disc.faces,
                discs.wxyz,
                discs.centre,
                batched_scales=discs.radius,
                batched_colors=np.tile(colours.for_instances(colours.UNKNOWN, LIT), (n, 1)),
                lod="off",
                side="front",
                **NO_SHADOW,
            )
            self._nodes.append(node or None)

    def move(self, poses: Poses) -> None:
        """Do nothing: they are in the frames of the links."""

    def show(self, tints: tuple[Colours, ...]) -> None:
        """Give them their colours, (n_tactels of the link, 3) by link."""
        for node, shown in zip(self._nodes, tints, strict=True):
            if node is not None:
                node.batched_colors = colours.for_instances(shown, LIT)


class SquareTactels:
    """A mesh for each shade, in the base frame."""

    def __init__(self, scene: Any, arm: Arm, poses: Poses) -> None:
        self._faces = SQUARE
        self._corners = [tactel_squares(arm, k) for k in range(len(arm.links))]
        """Of each link, (n, 4, 3) in its frame."""
        self._palette = colours.palette(N_SHADES)
        self._shades = np.full(sum(map(len, self._corners)), -1)
        self._moved = True
        self.move(poses)
        self._nodes = [
            scene.add_mesh_simple(
                f"/tactels {shade}",
                self._places[0],
                self._faces,
                color=colours.for_mesh((int(tint[0]), int(tint[1]), int(tint[2]))),
                side="front",
                visible=False,
                **NO_SHADOW,
            )
            for shade, tint in enumerate(self._palette)
        ]

    def move(self, poses: Poses) -> None:
        """Put the links to other poses."""
        parts = [placed(X, corners) for X, corners in zip(poses.X_BS, self._corners, strict=True)]
        self._places = np.concatenate(parts).astype(np.float32)
        self._moved = True

    def show(self, tints: tuple[Colours, ...]) -> None:
        """Give them the nearest shades of their colours, (n_tactels of the link, 3) by link."""
        shades = colours.nearest(self._palette, np.concatenate(tints))
        if self._moved:
            changed = np.arange(len(self._palette))
        else:
            differ = shades != self._shades
            changed = np.union1d(shades[differ], self._shades[differ])
        for shade in changed.tolist():
            here = np.flatnonzero(shades == shade)
            node = self._nodes[shade]
            if len(here):
                node.vertices = self._places[here].reshape(-1, 3)
                starts = np.arange(0, 4 * len(here), 4, dtype=np.uint32)
                node.faces = (self._faces + starts[:, None, None]).reshape(-1, 3)
            node.visible = bool(len(here))
        self._shades, self._moved = shades, False


def add_tactels(scene: Any, arm: Arm, poses: Poses) -> DiscTactels | SquareTactels:
    """Add the tactels of an arm to a scene whose links are there."""
    return SquareTactels(scene, arm, poses) if arm.n_tactels > MANY else DiscTactels(scene, arm)
