"""Reported covariance against the scatter of many answers to the same touch under fresh noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import Estimator
from tests.hard.ground import NOISE, Ground, distance_to, pressures_under, touch

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Spot:
    """Touches (u, v, force) on the second board of a ground, watched: the first of them."""

    name: str
    level: str
    touches: tuple[tuple[float, float, float], ...]


SPOTS: Final = (
    Spot("in the middle", "fit", ((0.002, 0.001, 5.0),)),
    Spot("on a tactel", "fit", ((0.005, 0.005, 5.0),)),
    Spot("on a seam", "fit", ((0.002, 0.0255, 40.0),)),
    Spot("two, 20 mm apart", "full", ((-0.009, 0.003, 6.0), (0.011, 0.003, 6.0))),
)


@dataclass(frozen=True, slots=True)
class Scatter:
    """Scatter over report of s, a and force; ``nees``, 3 where the whole covariance is right."""

    spot: str
    law: str
    n: int
    right: float
    """Part of the answers that had the right number of contacts; the others are left out."""
    s: float
    a: float
    force: float
    nees: float


def measure_scatter(spot: Spot, law: str, n: int, seed: int = 1) -> Scatter:
    """Return the scatter of n answers on the plane."""
    arm = Ground("plane", law).arm()
    touches = [touch(arm, 1, *row) for row in spot.touches]
    clean = pressures_under(arm, touches)
    estimator = Estimator(arm, spot.level)
    rng = np.random.default_rng(seed)
    _link, s, a, force = touches[0]
    errors, reports = np.zeros((n, 3)), np.zeros((n, 3, 3))
    found = 0
    for t_ns in range(n):
        contacts = estimator.update(clean + NOISE * rng.standard_normal(arm.n_tactels), t_ns)
        if len(contacts) != len(touches):
            continue
        c = int(distance_to(arm, touches[0], contacts.link, contacts.s, contacts.a).argmin())
        errors[found] = contacts.s[c] - s, contacts.a[c] - a, contacts.force[c] - force
        reports[found] = contacts.covariance[c]
        found += 1
    errors, reports = errors[:found], reports[:found]
    scatter = errors.std(axis=0)
    report = np.sqrt(np.diagonal(reports.mean(axis=0)))
    nees = np.einsum("ni,ni->n", errors, np.linalg.solve(reports, errors[..., None])[..., 0]).mean()
    s_ratio, a_ratio, force_ratio = (float(x) for x in scatter / report)
    return Scatter(spot.name, law, n, found / n, s_ratio, a_ratio, force_ratio, float(nees))
