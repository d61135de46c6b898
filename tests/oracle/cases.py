"""The cases of the accuracy tables: arms, fields and how touches are drawn."""

import numpy as np

from skinbus.model import Arm, grid
from tests.oracle.arms import forearm
from tests.oracle.fields import cone_field

CONE = cone_field
INSIDE = 0.015
"""Half the hull of the tactels of the paper's board, m."""


def pad(**settings):
    """Return the paper's board alone."""
    return Arm.single_patch(grid(4, 4, 0.010), **settings)


def arm(**settings):
    """Return a forearm of three rings of eight boards."""
    return forearm(**settings)


def one_inside(rng, force=(2.0, 20.0)):
    """One contact within the hull."""
    return [(0, *rng.uniform(-INSIDE, INSIDE, 2), rng.uniform(*force))]


def pair_inside(rng, apart=(0.006, 0.040), force=5.0):
    """Two contacts within the hull, in any direction."""
    while True:
        first = rng.uniform(-INSIDE, INSIDE, 2)
        d, angle = rng.uniform(*apart), rng.uniform(0.0, 2.0 * np.pi)
        second = first + d * np.array([np.cos(angle), np.sin(angle)])
        if np.abs(second).max() <= INSIDE:
            return [(0, *first, force), (0, *second, force)]


def three_inside(rng, apart=0.015, force=5.0):
    """Three contacts within the hull."""
    while True:
        places = rng.uniform(-INSIDE, INSIDE, (3, 2))
        if min(np.hypot(*(places[i] - places[j])) for i in range(3) for j in range(i)) >= apart:
            return [(0, *place, force) for place in places]


def on_seam(arm, force=5.0):
    """Return a draw of one contact on a seam along the arm, one around it, or a corner of four patches."""
    surface = arm.links[0].surface
    rings = np.unique(arm.patch_s)
    columns = np.unique(arm.patch_a)
    between = 0.5 * (rings[1:] + rings[:-1])
    half = 0.5 * surface.period / len(columns)

    def draw(rng):
        kind = rng.integers(3)
        s = rng.choice(between) if kind else rng.choice(rings) + rng.uniform(-INSIDE, INSIDE)
        a = rng.choice(columns) + (rng.uniform(-INSIDE, INSIDE) if kind == 1 else half)
        return [(0, float(s), float(surface.wrap(a)), force)]

    return draw


def pair_on_seam(arm, apart=(0.006, 0.040), force=5.0):
    """Return a draw of two contacts whose middle is on a seam or corner."""
    surface = arm.links[0].surface
    one = on_seam(arm, force)
    low, high = arm.tactel_s.min(), arm.tactel_s.max()

    def draw(rng):
        while True:
            _, s, a, _ = one(rng)[0]
            d, angle = 0.5 * rng.uniform(*apart), rng.uniform(0.0, 2.0 * np.pi)
            ds, da = d * np.cos(angle), d * np.sin(angle)
            if low <= s - abs(ds) and s + abs(ds) <= high:
                return [
                    (0, s + ds, float(surface.wrap(a + da)), force),
                    (0, s - ds, float(surface.wrap(a - da)), force),
                ]

    return draw
