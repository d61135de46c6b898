"""The skins of the accuracy tables, and the touches on them.

A skin is an arm as the estimator is given it, and a truth: a layer of the simulator, tactels with gains that
the estimator is not given, noise and counts. The paper's board, a forearm of it and a layout of triangles
feel by the cone itself. A board of rubber feels by an elastic layer under discs; it is calibrated by presses,
or has the law that boards ship with.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import combinations
from pathlib import Path

import numpy as np

from skinbus.estimate import learn_radial_law
from skinbus.model import Arm, Cone, Link, Patch, PlacedPatch, Surface, Transducer
from skinbus.model.patch import grid
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from skinbus.sim.effects.readings import Crosstalk
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.laws import ConeSettings, Elastic, HalfSpace
from skinbus.sim.layer import Geometry, Loads

PITCH = 0.010
NOISE = 200.0
"""Pa: 1 % of the peak under a usual touch, as in the EDS files."""
GAIN_SPREAD = 0.03
TRANSDUCER = Transducer(full_scale=250e3, bits=12)
TIP, FINGER, THUMB = 0.001, 0.006, 0.0125
"""m, radii of what presses."""
REACHED = 3
"""Tactels that a touch alone brings to the threshold, at least."""
INSIDE = 0.015
"""Half the hull of the tactels of the paper's board, m."""
APART = (0.006, 0.040)
"""Distance of two contacts, m."""
FORCE = 5.0
"""N"""
ELASTIC = Elastic()


@dataclass(frozen=True, slots=True)
class SkinModel:
    """An arm as the estimator is given it, and its true response and readings."""

    arm: Arm
    feel: Callable
    """Pressures (n_tactels,) Pa of touches (n, 3): s, a (m), force (N) on link 0."""
    read: Callable
    """What the estimator is given for true pressures: noise, counts, calibration."""


def hexagon():
    """Return the tactels (n, 2) m of six triangles around a point."""
    return np.loadtxt(Path(__file__).parent / "layouts" / "hexagon.csv", delimiter=",")[:, 1:]


def feel_of(arm, layer, indenter):
    """Return what an arm feels under a layer, of touches by a disc of this radius (m)."""
    law = layer.bind(Geometry.of(arm, discs=layer.discs), [Indenter(Shape.DISC, 2.0 * indenter)])

    def feel(touches):
        pressures, (s, a, force) = np.zeros(arm.n_tactels), touches.T
        law.add(Loads(len(s), s=s, a=a, force=force), pressures)
        return pressures

    return feel


def shipped_law():
    """Return the law of the usual board as its EDS holds it."""
    return describe_patch(load_eds("skin-patch", 1)).law


@lru_cache(maxsize=2)
def cone_forearm(rings=3):
    """Return rings of eight of the paper's boards, seams of 0 and 2 mm between rings."""
    pitch, around = 0.051, 8
    surface = Surface.cylinder(0.052 * rings, around * pitch / (2.0 * np.pi))
    places = [
        (0.026 + 0.050 * ring + 0.002 * (ring // 2), float(surface.wrap(i * pitch)))
        for ring in range(rings)
        for i in range(around)
    ]
    patch = Patch.default()
    placed = [PlacedPatch(patch=patch, node_id=k, link=0, s=s, a=a) for k, (s, a) in enumerate(places, 1)]
    return Arm("forearm", [Link("forearm", surface)], placed)


def cone_skin(arm, rng):
    """Return a skin whose truth is the cone that the estimator has."""
    return SkinModel(
        arm,
        feel_of(arm, ConeSettings(), 0.0),
        lambda pressures, rng: pressures + NOISE * rng.standard_normal(len(pressures)),
    )


def calibrated_skin(learned_with, pressed_by, rng, layer=ELASTIC):
    """Return a board of rubber calibrated by presses; radii of indenters, m."""
    arm = Arm.single_patch(grid(4, 4, PITCH), law=Cone(4e6), transducer=TRANSDUCER)  # Pa/m
    feel = feel_of(arm, layer, learned_with)
    response = 1.0 + GAIN_SPREAD * rng.standard_normal(arm.n_tactels)
    noise = 0.01 * float(feel(np.array([[0.5 * PITCH, 0.5 * PITCH, 5.0]])).max())

    def read(pressures, rng, gain=1.0):
        felt = pressures * response + noise * rng.standard_normal(len(pressures))
        return TRANSDUCER.pressure(TRANSDUCER.counts(felt)) * gain

    half, n = 0.020, 200  # m: the hull of the tactels, and half a pitch around it
    touches = np.column_stack([rng.uniform(-half, half, (n, 2)), rng.uniform(2.0, 20.0, n)])
    readings = np.stack([read(feel(touch[None]), rng) for touch in touches])
    learned = learn_radial_law(arm, *touches.T, readings)
    return SkinModel(learned.apply(arm), feel_of(arm, layer, pressed_by), partial(read, gain=learned.gain))


def shipped_skin(arm, indenter, rng, layer=ELASTIC, crosstalk=0.0):
    """Return rubber with the law that boards ship with and gains that the estimator is not given.

    ``crosstalk`` is the share of each other tactel of the row, and of the column, that a tactel reads.
    """
    arm = arm.with_law(shipped_law())
    response = 1.0 + GAIN_SPREAD * rng.standard_normal(arm.n_tactels)

    leak = Crosstalk(row=crosstalk, column=crosstalk).bind(arm, rng)

    def read(pressures, rng):
        return leak(pressures * response, 0.0) + NOISE * rng.standard_normal(len(pressures))

    return SkinModel(arm, feel_of(arm, layer, indenter), read)


def _step(rng, least, most):
    d, angle = rng.uniform(least, most), rng.uniform(0.0, math.tau)
    return np.array([d * math.cos(angle), d * math.sin(angle)])


def one(low, high, arm, rng):
    """Return one place inside the hull of the tactels."""
    return np.array([[*rng.uniform(-INSIDE, INSIDE, 2), rng.uniform(low, high)]])


def several(n, least, most, arm, rng):
    """Return places inside the hull of the tactels that are so far apart, m."""
    while True:
        places = rng.uniform(-INSIDE, INSIDE, (1 if n == 2 else n, 2))
        if n == 2:
            places = np.vstack([places, places[0] + _step(rng, least, most)])
        apart = [math.dist(*pair) for pair in combinations(places, 2)]
        if np.abs(places).max() <= INSIDE and min(apart) >= least - 1e-9:
            return np.column_stack([places, np.full(n, FORCE)])


def seam(n, arm, rng):
    """Return touches on seams along the arm, around it, and on corners of four patches, a third each.

    Two have their middle there, and are between the outermost tactels.
    """
    surface, low, high = arm.links[0].surface, arm.tactel_s.min(), arm.tactel_s.max()
    rings, columns = np.unique(arm.patch_s), np.unique(arm.patch_a)
    while True:
        kind = rng.integers(3)
        s = rng.choice(0.5 * (rings[1:] + rings[:-1]) if kind else rings)
        s += 0.0 if kind else rng.uniform(-INSIDE, INSIDE)
        a = rng.choice(columns)
        a += rng.uniform(-INSIDE, INSIDE) if kind == 1 else 0.5 * surface.period / len(columns)
        step = 0.5 * _step(rng, *APART) if n == 2 else np.zeros(2)
        places = np.array([s, a]) + np.array([step, -step])[:n]
        if n == 1 or (low <= places[:, 0].min() and places[:, 0].max() <= high):
            return np.column_stack([places[:, 0], surface.wrap(places[:, 1]), np.full(n, FORCE)])


def anywhere(n, arm, rng):
    """Return places within 4 mm of a tactel, half a pitch of the layouts of triangles; two are ``APART``."""
    i, surface = rng.integers(arm.n_tactels), arm.links[0].surface
    first = np.array([arm.tactel_s[i], arm.tactel_a[i]]) + rng.uniform(-0.004, 0.004, 2)
    while n == 2:
        second = first + _step(rng, *APART)
        if surface.distance(second[0], second[1], arm.tactel_s, arm.tactel_a).min() <= 0.004:
            return np.array([[*first, FORCE], [*second, FORCE]])
    return np.array([[*first, rng.uniform(2.0, 20.0)]])


def reached(skin, draw, rng):
    """Yield touches each of which alone reaches ``REACHED`` tactels."""
    while True:
        touches = draw(skin.arm, rng)
        if min((skin.feel(touch[None]) >= skin.arm.tactel_threshold).sum() for touch in touches) >= REACHED:
            yield touches


PAD = Arm.single_patch(grid(4, 4, PITCH))
SKINS = {
    "pad": partial(cone_skin, PAD),
    "forearm": partial(cone_skin, cone_forearm()),
    "hexagon": partial(cone_skin, Arm.single_patch(hexagon())),
    "tip": partial(calibrated_skin, TIP, TIP),
    "finger": partial(calibrated_skin, FINGER, FINGER),
    "finger, thumb": partial(calibrated_skin, FINGER, THUMB),
    "finger, tip": partial(calibrated_skin, FINGER, TIP),
    "box": partial(shipped_skin, PAD, FINGER),
    "box thumb": partial(shipped_skin, PAD, THUMB),
    "box tip": partial(shipped_skin, PAD, TIP),
    "box forearm": partial(shipped_skin, cone_forearm(), FINGER),
    "box crosstalk": partial(shipped_skin, PAD, FINGER, crosstalk=0.02),
    "box half-space": partial(shipped_skin, PAD, FINGER, layer=HalfSpace()),
    "finger half-space": partial(calibrated_skin, FINGER, FINGER, layer=HalfSpace()),
}
"""Of the cone; calibrated with and pressed by; out of the box. "hexagon" is six triangles around a point."""
DRAWS = {
    "one 2-20 N": partial(one, 2.0, 20.0),
    "one 5-20 N": partial(one, 5.0, 20.0),
    "one 2 N": partial(one, 2.0, 2.0),
    "two": partial(several, 2, *APART),
    "two 15 mm": partial(several, 2, 0.015, 0.015),
    "two 15-25 mm": partial(several, 2, 0.015, 0.025),
    "three": partial(several, 3, 0.015, 0.1),
    "seam": partial(seam, 1),
    "two on seam": partial(seam, 2),
    "one anywhere": partial(anywhere, 1),
    "two anywhere": partial(anywhere, 2),
}
"""Random touches: rows of s, a (m), force (N) on link 0."""
