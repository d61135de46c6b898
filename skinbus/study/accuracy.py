"""Accuracy of a family of cases: random touches, the answers, their ratio to the Cramer-Rao bound.

``python -m skinbus.study.accuracy docs/estimator.md`` makes the table of that page.

The ratio of a row is the median over its contacts of (error / standard deviation at the bound of that very
contact), divided by the same median of ideal estimators: errors drawn from the normal distribution that the
bound of each contact allows. 1 is the bound. Errors are those of the cases with the right count, contacts
assigned to touches by least distance in sum. A touch is reached by a tactel that it alone brings to the
threshold; cases with a touch that reaches fewer than three are excluded and counted.
"""

from __future__ import annotations

import math
import sys
import zlib
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from skinbus.estimate import LEVELS, Contacts, Estimator
from skinbus.study.accuracy_draws import DRAWS
from skinbus.study.crb import bound, ideal_distances, position_bound
from skinbus.study.marked import Marks
from skinbus.study.skin_models import SKINS, SkinModel

Floats = npt.NDArray[np.float64]

REACHED: Final = 3
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
        }


def run_chunk(cases: Cases, chunk: int, n: int, seed: int) -> Tally:
    """Return the tally of piece ``chunk`` of a family: n cases on one skin."""
    rng = np.random.default_rng([seed, chunk, zlib.crc32(cases.key.encode())])
    skin = SKINS[cases.skin](rng)
    estimator = Estimator(skin.arm, cases.level)
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


FAMILIES: Final = (
    ("cone truth, one of 2-20 N", "pad", "one 2-20 N"),
    ("cone truth, one of 5 N on seams and corners", "forearm", "seam"),
    ("cone truth, two of 5 N", "pad", "two"),
    ("cone truth, two of 5 N across seams", "forearm", "two on seam"),
    ("cone truth, three of 5 N", "pad", "three"),
    ("calibrated, finger of 5-20 N", "finger", "one 5-20 N"),
    ("calibrated, finger of 2 N", "finger", "one 2 N"),
    ("calibrated, two fingers 15 mm apart", "finger", "two 15 mm"),
    ("calibrated with a finger, pressed by a thumb", "finger, thumb", "one 2-20 N"),
    ("calibrated with a finger, pressed by a tip", "finger, tip", "one 2-20 N"),
    ("as it ships, finger of 2-20 N", "box", "one 2-20 N"),
    ("as it ships, finger on seams and corners", "box forearm", "seam"),
    ("as it ships, two fingers across seams", "box forearm", "two on seam"),
    ("as it ships, thumb", "box thumb", "one 2-20 N"),
)
"""Title, skin and draw of each family in the table."""
COLUMNS: Final = ("count right", "RMS position mm", "RMS force %", "position ratio", "covariance")
CHUNK: Final = 250
"""Cases of one piece of work; a skin with gains of its own is drawn and calibrated for each."""
CHUNKS: Final = 4
SEED: Final = 90_000
"""Of the table; seeds below 100 are those of tests."""


def write_accuracy(page: Path) -> None:
    """Measure all families at levels fit and full, and write the table between the marks of a page."""
    marks = Marks("<!-- table: made by python -m skinbus.study.accuracy -->", "<!-- end of table -->")
    marks.read(page)  # refused now, not after minutes
    lines = [f"| touches | level | {' | '.join(COLUMNS)} |", "|---|---|" + "---|" * len(COLUMNS)]
    with ProcessPoolExecutor() as pool:
        work = [
            (title, level, [pool.submit(run_chunk, cases, k, CHUNK, SEED) for k in range(CHUNKS)])
            for title, skin, draw in FAMILIES
            for level in LEVELS[1:]
            for cases in [Cases(skin=skin, draw=draw, level=level)]
        ]
        for title, level, pieces in work:
            tally = Tally()
            for piece in pieces:
                tally += piece.result()
            figures = tally.figures()
            cells = " | ".join(f"{figures[name]:.3g}" for name in COLUMNS)
            lines.append(f"| {title} | {level} | {cells} |")
    marks.write(page, "\n".join(lines))


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else math.nan


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else math.nan


if __name__ == "__main__":
    write_accuracy(Path(sys.argv[1]))
