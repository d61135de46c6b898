"""Arms of any size and busy scenes on them, for measuring speed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from skinbus.model import Arm, Link, PlacedPatch, Surface
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from skinbus.sim.effect import Effect
from skinbus.sim.indenter import Shape
from skinbus.sim.laws import Elastic
from skinbus.sim.scene import Scene
from skinbus.sim.touch import Touch

MAX_PATCHES: Final = 126
"""Node-IDs that are left when the master has one."""
SYNC_S: Final = 1e-3
"""Scene time between samples: 1 kHz."""

_RING: Final = 9
_PITCH: Final = 0.051
_TOUCHES: Final = 5
_EDS: Final = "skin-patch"


def long_arm(n_patches: int) -> Arm:
    """Return a cylinder with rings of nine boards, the last ring as full as need be."""
    rings = -(-n_patches // _RING)
    surface = Surface.cylinder(rings * _PITCH, _RING * _PITCH / math.tau)
    board = describe_patch(load_eds(_EDS, 1), _EDS)
    patches = [
        PlacedPatch(
            patch=board,
            node_id=1 + p,
            link=0,
            s=(p // _RING + 0.5) * _PITCH,
            a=float(surface.wrap(p % _RING * _PITCH)),
            eds=_EDS,
        )
        for p in range(n_patches)
    ]
    return Arm(f"{n_patches} patches", [Link("arm", surface)], patches)


def busy_scene(arm: Arm, effects: Sequence[Effect] = (), *, n_touches: int = _TOUCHES) -> Scene:
    """Return a scene of fingertips that press for good, spread over an arm."""
    touches = []
    for k in range(n_touches):
        placed = arm.patches[k * arm.n_patches // n_touches]
        path = np.array([[0.0, placed.s + 0.004, placed.a + 0.003]])
        force = np.array([[0.0, 5.0], [1e6, 5.0]])
        touches.append(Touch(link=placed.link, path=path, force=force, shape=Shape.DISC, length=0.012))
    return Scene("busy", arm, duration_s=1e6, layer=Elastic(), touches=touches, effects=effects)
