"""What hard cases stand on: an arm of each surface under each contact law, and the places that matter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.model import Arm, Cone, Law, Link, Patch, PlacedPatch, Radial, Surface, grid
from skinbus.sim.bonded_layer import profile

Floats = npt.NDArray[np.float64]
Touch = tuple[int, float, float, float]
"""Link, s and a (m), force (N)."""

SURFACES: Final = ("plane", "cylinder", "frustum")
LAWS: Final = ("cone", "radial")
BOARD: Final = 0.050
SEAM: Final = 0.001
PITCH: Final = 0.010
NOISE: Final = 200.0
"""Pa: 1 % of the peak of a 5 N contact."""
THRESHOLD: Final = 1000.0
FULL_SCALE: Final = 250e3

_STEP = BOARD + SEAM
_RINGS, _AROUND = 2, 6


@cache
def law_of(kind: str) -> Law:
    """Return the paper's cone, or the radial law of an elastic layer of 6 mm under disc-shaped tactels."""
    if kind == "cone":
        return Cone(1.2e6)
    step = 0.75e-3
    k = profile(
        step * np.arange(64), thickness=6e-3, poisson=0.48, tactel_radius=4.765e-3, indenter_radius=6e-3
    )
    return Radial(step, k)


@dataclass(frozen=True, slots=True)
class Ground:
    """A surface and a law; cases build their arm on it."""

    surface: str
    law: str

    def arm(self, law: Law | None = None, **settings: Any) -> Arm:
        """Return two rings of boards (two rows on the plane); ``settings`` go to every patch."""
        if law is None and not settings:
            return _usual_arm(self)
        settings.setdefault("tactels_uv", grid(4, 4, PITCH))
        patch = Patch(law=law or law_of(self.law), **settings)
        return self.mount([patch] * (_RINGS * (3 if self.surface == "plane" else _AROUND)))

    def mount(self, patches: Sequence[Patch]) -> Arm:
        """Return these boards at the usual places, ring after ring; fewer leave places empty."""
        link = Link(self.surface, surface_of(self.surface))
        placed = []
        around = 3 if self.surface == "plane" else _AROUND
        for n, patch in enumerate(patches):
            ring, column = divmod(n, around)
            a = (column - 1) * _STEP
            if self.surface != "plane":  # the wrap line is a seam
                a = float(link.surface.wrap((column + 0.5) * link.surface.period / around))
            placed.append(PlacedPatch(patch=patch, node_id=n + 1, link=0, s=0.5 * _STEP + ring * _STEP, a=a))
        return Arm(f"{self.surface} {self.law}", [link], placed)

    def board(self, tactels_uv: Floats, law: Law | None = None, **settings: Any) -> Arm:
        """Return one board with its own tactels where the first patch of the usual arm is."""
        return self.mount([Patch(tactels_uv=tactels_uv, law=law or law_of(self.law), **settings)])


@cache
def _usual_arm(ground: Ground) -> Arm:
    patch = Patch(tactels_uv=grid(4, 4, PITCH), law=law_of(ground.law))
    return ground.mount([patch] * (_RINGS * (3 if ground.surface == "plane" else _AROUND)))


@cache
def surface_of(kind: str) -> Surface:
    """Return the plate, the cylinder or the frustum that carries the boards."""
    if kind == "plane":
        return Surface.plane(_RINGS * _STEP, 3 * _STEP)
    radius = _AROUND * _STEP / math.tau
    if kind == "cylinder":
        return Surface.cylinder(_RINGS * _STEP, radius)
    return Surface.cone(_RINGS * _STEP, 1.18 * radius, 1.02 * radius)


def place(arm: Arm, patch: int, u: float, v: float) -> tuple[float, float]:
    """Return (s, a) of a point (u, v) m of a board's plane, on the board or beside it."""
    placed = arm.patches[patch]
    cos, sin = math.cos(placed.yaw), math.sin(placed.yaw)
    x, y = placed.s + cos * u - sin * v, sin * u + cos * v
    s, a = arm.links[placed.link].surface.undevelop(x, y, placed.a)
    return float(s), float(a)


def touch(arm: Arm, patch: int, u: float, v: float, force: float) -> Touch:
    """Return a touch at a point of a board's plane."""
    return (arm.patches[patch].link, *place(arm, patch, u, v), force)


def pressures_under(arm: Arm, touches: Sequence[Touch]) -> Floats:
    """Return what the tactels of an arm feel of touches by each patch's own law, without noise, Pa."""
    total = np.zeros(arm.n_tactels)
    for link, s, a, force in touches:
        surface = arm.links[link].surface
        for p, placed in enumerate(arm.patches):
            if placed.link == link:
                on = arm.tactels_of(p)
                d = surface.distance(s, a, arm.tactel_s[on], arm.tactel_a[on])
                total[on] += placed.patch.law.pressure(d, force)
    return total


def distance_to(arm: Arm, touched: Touch, link: Any, s: Floats, a: Floats) -> Floats:
    """Return the geodesic distances (m) of contacts from a touch, infinite on other links."""
    d = arm.links[touched[0]].surface.distance(touched[1], touched[2], s, a)
    return np.where(np.asarray(link) == touched[0], d, np.inf)
