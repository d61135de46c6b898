"""What hard cases stand on: an arm of each surface under each contact law, and the places that matter."""

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from skinbus.model import Arm, Cone, Link, Patch, PlacedPatch, Radial, Surface, grid
from skinbus.sim.bonded_layer import profile

SURFACES = ("plane", "cylinder", "frustum")
LAWS = ("cone", "radial")
PITCH = 0.010
NOISE = 200.0
"""Pa: 1 % of the peak of a 5 N contact."""
THRESHOLD = 1000.0
FULL_SCALE = 250e3

_STEP = 0.051
"""From board to board: boards of 50 mm, seams of 1 mm (m)."""
_RINGS, _AROUND = 2, 6


@cache
def law_of(kind):
    """The paper's cone, or the radial law of an elastic layer of 6 mm under disc-shaped tactels."""
    if kind == "cone":
        return Cone(1.2e6)
    d = 0.75e-3 * np.arange(64)
    k = profile(d, thickness=6e-3, poisson=0.48, tactel_radius=4.765e-3, indenter_radius=6e-3)
    return Radial(d[1], k)


class Ground(NamedTuple):
    """A surface and a law; cases build their arm on it."""

    surface: str
    law: str

    def arm(self, **settings):
        """Two rings of boards (two rows on the plane); ``settings`` go to every patch."""
        return self.of_boards(**settings) if settings else _usual_arm(self)

    def of_boards(self, **settings):
        patch = Patch(**{"tactels_uv": grid(4, 4, PITCH), "law": law_of(self.law), **settings})
        return self.mount([patch] * (_RINGS * (3 if self.surface == "plane" else _AROUND)))

    def mount(self, patches):
        """These boards at the usual places, ring after ring; fewer leave places empty."""
        surface, placed = surface_of(self.surface), []
        around = 3 if self.surface == "plane" else _AROUND
        for n, patch in enumerate(patches):
            ring, column = divmod(n, around)
            a = (column - 1) * _STEP
            if self.surface != "plane":  # the wrap line is a seam
                a = float(surface.wrap((column + 0.5) * surface.period / around))
            placed.append(PlacedPatch(patch=patch, node_id=n + 1, link=0, s=(0.5 + ring) * _STEP, a=a))
        return Arm(f"{self.surface} {self.law}", [Link(self.surface, surface)], placed)

    def board(self, tactels_uv, **settings):
        """One board with its own tactels where the first patch of the usual arm is."""
        return self.mount([Patch(tactels_uv=tactels_uv, law=law_of(self.law), **settings)])


@cache
def _usual_arm(ground):
    return ground.of_boards()


@cache
def surface_of(kind):
    """The plate, the cylinder or the frustum that carries the boards."""
    length, radius = _RINGS * _STEP, _AROUND * _STEP / math.tau
    return {
        "plane": Surface.plane(length, 3 * _STEP),
        "cylinder": Surface.cylinder(length, radius),
        "frustum": Surface.cone(length, 1.18 * radius, 1.02 * radius),
    }[kind]


def touch(arm, patch, u, v, force):
    """A touch (link, s and a in m, force in N) at (u, v) m of a board's plane, on the board or beside it."""
    placed = arm.patches[patch]
    cos, sin = math.cos(placed.yaw), math.sin(placed.yaw)
    x, y = placed.s + cos * u - sin * v, sin * u + cos * v
    s, a = arm.links[placed.link].surface.undevelop(x, y, placed.a)
    return placed.link, float(s), float(a), force


def pressures_under(arm, touches):
    """What the tactels of an arm feel of touches by each patch's own law, without noise, Pa."""
    total, boards = np.zeros(arm.n_tactels), {}
    for p, placed in enumerate(arm.patches):
        boards.setdefault((placed.link, placed.patch.law), []).append(arm.tactels_of(p))
    for (link, law), tactels in boards.items():
        on, surface = np.r_[*tactels], arm.links[link].surface
        for _, s, a, force in (touch for touch in touches if touch[0] == link):
            total[on] += law.pressure(surface.distance(s, a, arm.tactel_s[on], arm.tactel_a[on]), force)
    return total


def distance_to(arm, touched, contacts):
    """Geodesic distances (m) of contacts from a touch, infinite on other links."""
    d = arm.links[touched[0]].surface.distance(touched[1], touched[2], contacts.s, contacts.a)
    return np.where(contacts.link == touched[0], d, np.inf)
