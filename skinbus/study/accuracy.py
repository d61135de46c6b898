"""Accuracy of a family of cases: random touches on a skin, and the answers of a level.

Errors are those of the cases with the right count, contacts assigned to touches by least distance in sum. A
touch is reached by a tactel that it alone brings to the threshold; cases with a touch that reaches fewer than
three are left out.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from skinbus.estimate import Contacts, Estimator
from skinbus.model import Arm
from skinbus.study.skin_models import SKINS, SkinModel

Floats = npt.NDArray[np.float64]

REACHED: Final = 3
PERIOD_NS: Final = 20_000_000
INSIDE: Final = 0.015
"""Half the hull of the tactels of the paper's board, m."""
APART: Final = (0.006, 0.040)
"""Distance of two contacts, m."""
FORCE: Final = 5.0
"""N"""


def _step(rng: np.random.Generator, least: float, most: float) -> Floats:
    d, angle = rng.uniform(least, most), rng.uniform(0.0, math.tau)
    return np.array([d * math.cos(angle), d * math.sin(angle)])


def _one(low: float, high: float, arm: Arm, rng: np.random.Generator) -> Floats:
    return np.array([[*rng.uniform(-INSIDE, INSIDE, 2), rng.uniform(low, high)]])


def _several(n: int, least: float, most: float, arm: Arm, rng: np.random.Generator) -> Floats:
    """Return places inside the hull of the tactels that are so far apart, m."""
    while True:
        places = rng.uniform(-INSIDE, INSIDE, (1 if n == 2 else n, 2))
        if n == 2:
            places = np.vstack([places, places[0] + _step(rng, least, most)])
        apart = [math.dist(*pair) for pair in combinations(places, 2)]
        if np.abs(places).max() <= INSIDE and min(apart) >= least - 1e-9:
            return np.column_stack([places, np.full(n, FORCE)])


def _seam(n: int, arm: Arm, rng: np.random.Generator) -> Floats:
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


def _anywhere(n: int, arm: Arm, rng: np.random.Generator) -> Floats:
    """Return places within 4 mm of a tactel, half a pitch of the layouts of triangles; two are ``APART``."""
    i, surface = rng.integers(arm.n_tactels), arm.links[0].surface
    first = np.array([arm.tactel_s[i], arm.tactel_a[i]]) + rng.uniform(-0.004, 0.004, 2)
    while n == 2:
        second = first + _step(rng, *APART)
        if surface.distance(second[0], second[1], arm.tactel_s, arm.tactel_a).min() <= 0.004:
            return np.array([[*first, FORCE], [*second, FORCE]])
    return np.array([[*first, rng.uniform(2.0, 20.0)]])


DRAWS: Final[dict[str, Callable[[Arm, np.random.Generator], Floats]]] = {
    "one 2-20 N": partial(_one, 2.0, 20.0),
    "one 5-20 N": partial(_one, 5.0, 20.0),
    "one 2 N": partial(_one, 2.0, 2.0),
    "two": partial(_several, 2, *APART),
    "two 15 mm": partial(_several, 2, 0.015, 0.015),
    "three": partial(_several, 3, 0.015, 0.1),
    "seam": partial(_seam, 1),
    "two on seam": partial(_seam, 2),
    "one anywhere": partial(_anywhere, 1),
    "two anywhere": partial(_anywhere, 2),
}
"""Random touches: rows of s, a (m), force (N) on link 0."""


@dataclass(slots=True)
class Tally:
    """What cases gave; adding two joins them."""

    cases: int = 0
    right: int = 0
    position: list[float] = field(default_factory=list)
    """m"""
    force: list[float] = field(default_factory=list)
    """Relative errors."""
    nees: list[float] = field(default_factory=list)
    """Squared error of (s, a, force) normalised by the reported covariance, over its 3 degrees of freedom."""

    def __iadd__(self, other: Tally) -> Tally:
        for name in self.__slots__:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        return self

    def figures(self) -> dict[str, float]:
        """Return the figures that rows of the tables ask for, by their names."""
        return {
            "count right": self.right / max(self.cases, 1),
            "RMS position mm": 1e3 * _rms(self.position),
            "RMS force %": 1e2 * _rms(self.force),
            "covariance": float(np.mean(self.nees)) if self.nees else math.nan,
        }


def run_chunk(skin_name: str, draw: str, level: str, chunk: int, n: int, seed: int) -> Tally:
    """Return the tally of piece ``chunk`` of a family: n cases on one skin, the same at all levels."""
    rng = np.random.default_rng([seed, chunk, zlib.crc32(f"{skin_name} {draw}".encode())])
    skin, tally = SKINS[skin_name](rng), Tally()
    estimator, threshold = Estimator(skin.arm, level), skin.arm.tactel_threshold
    while tally.cases < n:
        touches = DRAWS[draw](skin.arm, rng)
        if min((skin.feel(touch[None]) >= threshold).sum() for touch in touches) < REACHED:
            continue
        tally.cases += 1
        contacts = estimator.update(skin.read(skin.feel(touches), rng), tally.cases * PERIOD_NS)
        if len(contacts) == len(touches):
            tally.right += 1
            _compare(tally, skin, touches, contacts)
    return tally


def _compare(tally: Tally, skin: SkinModel, touches: Floats, contacts: Contacts) -> None:
    """Add the errors of one case."""
    surface = skin.arm.links[0].surface
    distance = surface.distance(touches[:, :1], touches[:, 1:2], contacts.s, contacts.a)
    for row, column in zip(*linear_sum_assignment(distance), strict=True):
        s, a, force = touches[row]
        error = np.array(
            [contacts.s[column] - s, surface.wrap(contacts.a[column] - a), contacts.force[column] - force]
        )
        tally.position.append(float(distance[row, column]))
        tally.force.append(float(error[2] / force))
        covariance = contacts.covariance[column]
        if covariance.any():
            tally.nees.append(float(error @ np.linalg.solve(covariance, error)) / 3.0)


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else math.nan
