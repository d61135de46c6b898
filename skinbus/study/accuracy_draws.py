"""Random touches of the accuracy tables: one, two or three, inside a patch, on seams, on corners, anywhere.

"Inside" is within the hull of the tactels. A draw gives rows of s, a (m), force (N) on link 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Draw = Callable[[np.random.Generator], Floats]

INSIDE: Final = 0.015
"""Half the hull of the tactels of the paper's board, m."""
APART: Final = (0.006, 0.040)
"""Distance of two contacts, m."""
FORCE: Final = 5.0
"""N"""


def _one(low: float, high: float) -> Callable[[Arm], Draw]:
    def of(arm: Arm) -> Draw:
        return lambda rng: np.array([[*_place(rng), rng.uniform(low, high)]])

    return of


def _two(least: float, most: float) -> Callable[[Arm], Draw]:
    def of(arm: Arm) -> Draw:
        def draw(rng: np.random.Generator) -> Floats:
            while True:
                first = _place(rng)
                second = first + _step(rng, least, most)
                if np.abs(second).max() <= INSIDE:
                    return _pressed(first, second)

        return draw

    return of


def _three(arm: Arm) -> Draw:
    def draw(rng: np.random.Generator) -> Floats:
        while True:
            places = rng.uniform(-INSIDE, INSIDE, (3, 2))
            apart = [math.dist(places[i], places[j]) for i in range(3) for j in range(i)]
            if min(apart) >= 0.015:
                return _pressed(*places)

    return draw


def _seam(arm: Arm) -> Draw:
    """Seams along the arm, around it, and corners of four patches, a third each; the wrap is one of them."""
    surface = arm.links[0].surface
    rings, columns = np.unique(arm.patch_s), np.unique(arm.patch_a)
    between = 0.5 * (rings[1:] + rings[:-1])
    half = 0.5 * surface.period / len(columns)

    def draw(rng: np.random.Generator) -> Floats:
        kind = rng.integers(3)
        s = rng.choice(between) if kind else rng.choice(rings) + rng.uniform(-INSIDE, INSIDE)
        a = rng.choice(columns) + (rng.uniform(-INSIDE, INSIDE) if kind == 1 else half)
        return np.array([[s, float(surface.wrap(a)), FORCE]])

    return draw


def _two_on_seam(arm: Arm) -> Draw:
    """Two with their middle on a seam or corner, both between the outermost tactels."""
    surface, seam = arm.links[0].surface, _seam(arm)
    low, high = arm.tactel_s.min(), arm.tactel_s.max()

    def draw(rng: np.random.Generator) -> Floats:
        while True:
            middle, step = seam(rng)[0, :2], 0.5 * _step(rng, *APART)
            if low <= middle[0] - abs(step[0]) and middle[0] + abs(step[0]) <= high:
                touches = _pressed(middle + step, middle - step)
                touches[:, 1] = surface.wrap(touches[:, 1])
                return touches

    return draw


def _anywhere(n: int) -> Callable[[Arm], Draw]:
    """Places within 4 mm of a tactel, half a pitch of these layouts; two are ``APART``."""

    def of(arm: Arm) -> Draw:
        surface = arm.links[0].surface

        def draw(rng: np.random.Generator) -> Floats:
            i = rng.integers(arm.n_tactels)
            first = np.array([arm.tactel_s[i], arm.tactel_a[i]]) + rng.uniform(-0.004, 0.004, 2)
            if n == 1:
                return np.array([[*first, rng.uniform(2.0, 20.0)]])
            while True:
                second = first + _step(rng, *APART)
                near = surface.distance(second[0], second[1], arm.tactel_s, arm.tactel_a).min()
                if near <= 0.004:
                    return _pressed(first, second)

        return draw

    return of


def _place(rng: np.random.Generator) -> Floats:
    return np.asarray(rng.uniform(-INSIDE, INSIDE, 2))


def _step(rng: np.random.Generator, least: float, most: float) -> Floats:
    d, angle = rng.uniform(least, most), rng.uniform(0.0, math.tau)
    return np.array([d * math.cos(angle), d * math.sin(angle)])


def _pressed(*places: Floats) -> Floats:
    return np.array([[*place, FORCE] for place in places])


DRAWS: Final[dict[str, Callable[[Arm], Draw]]] = {
    "one 2-20 N": _one(2.0, 20.0),
    "one 5-20 N": _one(5.0, 20.0),
    "one 2 N": _one(2.0, 2.0),
    "two": _two(*APART),
    "two 15 mm": _two(0.015, 0.015),
    "three": _three,
    "seam": _seam,
    "two on seam": _two_on_seam,
    "one anywhere": _anywhere(1),
    "two anywhere": _anywhere(2),
}
