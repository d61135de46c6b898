"""Accuracy of a family of cases: random touches, the answers, their ratio to the Cramer-Rao bound.

The ratio of a row is the median over its contacts of (error / standard deviation at the bound of that very
contact), divided by the same median of ideal estimators: errors drawn from the normal distribution that the
bound of each contact allows. 1 is the bound. Errors are those of the cases with the right count, contacts
assigned to touches by least distance in sum. A touch is reached by a tactel that it alone brings to the
threshold; cases with a touch that reaches fewer than three are excluded and counted.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from skinbus.estimate import Contacts, Estimator
from skinbus.study.accuracy_draws import DRAWS
from skinbus.study.crb import bound, ideal_distances, position_bound
from skinbus.study.skin_models import SKINS, SkinModel

Floats = npt.NDArray[np.float64]

REACHED: Final = 3
CHUNK: Final = 250
"""Cases of one piece of work; a skin with gains of its own is drawn and calibrated for each."""
IDEAL_DRAWS: Final = 40
"""Errors of ideal estimators for each contact: their median is then much surer than the one it is for."""
NORMAL_MEDIAN: Final = 0.67448975
"""Median of |z| of a standard normal z."""
PERIOD_NS: Final = 20_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Cases:
    """A family of cases: where they are, what presses, what answers."""

    skin: str
    draw: str
    """A name in ``accuracy_draws.DRAWS``."""
    level: str
    cases: int

    @property
    def key(self) -> str:
        """What names the family, and with a seed fixes its draws: the level does not enter."""
        return f"{self.skin} {self.draw}"


@dataclass(slots=True)
class Tally:
    """What cases gave; adding two joins them."""

    cases: int = 0
    excluded: int = 0
    right: int = 0
    contacts: int = 0
    """Contacts reported, right or not."""
    position: list[float] = field(default_factory=list)
    """m"""
    force: list[float] = field(default_factory=list)
    """Relative errors."""
    position_ratio: list[float] = field(default_factory=list)
    force_ratio: list[float] = field(default_factory=list)
    bound_position: list[float] = field(default_factory=list)
    """Standard deviations at the bound, m."""
    bound_force: list[float] = field(default_factory=list)
    """Relative."""
    ideal: list[float] = field(default_factory=list)
    """Position ratios of ideal estimators."""
    nees: list[float] = field(default_factory=list)
    """Squared error of (s, a, force) normalised by the reported covariance, over its 3 degrees of freedom."""

    def __iadd__(self, other: Tally) -> Tally:
        for name in self.__slots__:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        return self

    def figures(self) -> dict[str, float]:
        """Return the figures that rows of the tables ask for, by their names."""
        return {
            "position ratio": _median(self.position_ratio) / max(_median(self.ideal), 1e-300),
            "force ratio": _median(self.force_ratio) / NORMAL_MEDIAN,
            "count right": self.right / max(self.cases, 1),
            "RMS position mm": 1e3 * _rms(self.position),
            "RMS force %": 1e2 * _rms(self.force),
            "bound RMS position mm": 1e3 * _rms(self.bound_position),
            "bound RMS force %": 1e2 * _rms(self.bound_force),
            "covariance": float(np.mean(self.nees)) if self.nees else math.nan,
            "false contacts": float(self.contacts),
        }


def run_chunk(cases: Cases, chunk: int, n: int, seed: int) -> Tally:
    """Return the tally of piece ``chunk`` of a family: n cases on one skin."""
    rng = np.random.default_rng([seed, chunk, zlib.crc32(cases.key.encode())])
    skin = SKINS[cases.skin](rng)
    estimator = Estimator(skin.arm, cases.level)
    if cases.draw == "nothing":
        return _count_false(skin, estimator, n, rng)
    draw = DRAWS[cases.draw](skin.arm)
    threshold = skin.arm.tactel_threshold
    tally = Tally()
    while tally.cases < n:
        touches = draw(rng)
        if min((skin.feel(touch[None]) >= threshold).sum() for touch in touches) < REACHED:
            tally.excluded += 1
            continue
        tally.cases += 1
        contacts = estimator.update(skin.read(skin.feel(touches), rng), tally.cases * PERIOD_NS)
        tally.contacts += len(contacts)
        if len(contacts) == len(touches):
            tally.right += 1
            _compare(tally, skin, touches, contacts, rng)
    return tally


def _compare(
    tally: Tally, skin: SkinModel, touches: Floats, contacts: Contacts, rng: np.random.Generator
) -> None:
    """Add the errors of one case."""
    surface = skin.arm.links[0].surface
    distance = surface.distance(touches[:, :1], touches[:, 1:2], contacts.s, contacts.a)
    bounds = bound(skin.feel, touches, skin.noise)
    for row, column in zip(*linear_sum_assignment(distance), strict=True):
        force = touches[row, 2]
        error = np.array(
            [
                contacts.s[column] - touches[row, 0],
                float(surface.wrap(contacts.a[column] - touches[row, 1])),
                contacts.force[column] - force,
            ]
        )
        tally.position.append(float(distance[row, column]))
        tally.force.append(float(error[2] / force))
        if contacts.covariance[column].any():
            tally.nees.append(float(error @ np.linalg.solve(contacts.covariance[column], error)) / 3.0)
        least = bounds[row]
        if np.isfinite(least).all():
            away = float(position_bound(bounds)[row])
            tally.bound_position.append(away)
            tally.bound_force.append(math.sqrt(least[2, 2]) / force)
            tally.position_ratio.append(float(distance[row, column]) / away)
            tally.force_ratio.append(float(abs(error[2]) / math.sqrt(least[2, 2])))
            off = ideal_distances(bounds[row : row + 1], IDEAL_DRAWS, rng)
            tally.ideal += (off[0] / away).tolist()


def _count_false(skin: SkinModel, estimator: Estimator, n: int, rng: np.random.Generator) -> Tally:
    """Return the tally of n cycles of noise alone."""
    nothing = np.zeros(skin.arm.n_tactels)
    tally = Tally(cases=n)
    for i in range(n):
        contacts = len(estimator.update(skin.read(nothing, rng), i * PERIOD_NS))
        tally.contacts += contacts
        tally.right += not contacts
    return tally


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else math.nan


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else math.nan
