"""Random readings biased to extremes: whatever they are, what leaves the estimator is sound.

A cycle mixes, tactel by tactel, readings from a pool: zeros, the smallest and largest numbers, not a number,
full scale and one count beside it, thresholds, noise, and the fields of true touches.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import LEVELS, Estimator
from skinbus.model import Arm
from tests.hard.check import WORK_PER_TACTEL, check_contacts
from tests.hard.ground import (
    FULL_SCALE,
    LAWS,
    NOISE,
    SURFACES,
    THRESHOLD,
    Ground,
    pressures_under,
)

Floats = npt.NDArray[np.float64]

COUNT: Final = FULL_SCALE / 32767.0
POOL: Final = np.array(
    [
        *(0.0, -0.0, 5e-324, -5e-324, 1e-300, -1e-300, 1e300, -1e300, np.nan, np.inf, -np.inf),
        *(FULL_SCALE, FULL_SCALE - COUNT, FULL_SCALE + COUNT, -FULL_SCALE, -FULL_SCALE - COUNT),
        *(THRESHOLD, np.nextafter(THRESHOLD, 0.0), 0.7 * THRESHOLD, 3.0 * NOISE, COUNT, -COUNT),
        *(1e3, 5e3, 2e4, 1e5),
    ]
)


@dataclass(slots=True)
class Extremes:
    """What many cycles gave; ``faults`` says for which seed and cycle."""

    n: int = 0
    n_contacts: int = 0
    most_contacts: int = 0
    most_work: float = 0.0
    """Pressures evaluated per tactel of the arm, at most."""
    most_ms: float = 0.0
    faults: list[str] = field(default_factory=list)


def arms() -> list[Arm]:
    """Return one board and two across a seam, under both laws, on all surfaces."""
    out = []
    for n, (surface, law) in enumerate(product(SURFACES, LAWS)):
        ground = Ground(surface, law)
        out.append(ground.mount([ground.arm().patches[0].patch] * (1 + n % 2)))
        out.append(ground.mount([ground.arm().patches[0].patch] * (2 - n % 2)))
    return out


def random_readings(arm: Arm, rng: np.random.Generator) -> Floats:
    """Return one cycle of readings."""
    n = arm.n_tactels
    kind = rng.integers(4)
    if kind == 0:  # a pattern of few values
        values = rng.choice(POOL, size=rng.integers(1, 4))
        return np.asarray(rng.choice(values, size=n))
    fields = NOISE * rng.standard_normal(n) * (10.0 ** rng.uniform(-3, 2) if kind == 3 else 1.0)
    for _ in range(rng.integers(0, 6)):
        p = arm.patches[rng.integers(arm.n_patches)]
        u, v = rng.uniform(-0.03, 0.03, 2)
        force = 10.0 ** rng.uniform(-3.0, 4.0)
        fields = fields + pressures_under(arm, [(0, p.s + u, p.a + v, force)])
    broken = rng.random(n) < rng.choice([0.0, 0.05, 0.5])
    return np.where(broken, rng.choice(POOL, size=n), fields)


def run_extremes(n: int, seed: int = 1, done: Callable[[int], None] | None = None) -> Extremes:
    """Return what n cycles gave, spread evenly over arms and levels."""
    result = Extremes()
    estimators = [Estimator(arm, LEVELS[-1]) for arm in arms()]
    rng = np.random.default_rng(seed)
    for cycle in range(n):
        estimator = estimators[cycle % len(estimators)]
        arm, level = estimator.arm, LEVELS[cycle // len(estimators) % len(LEVELS)]
        readings = random_readings(arm, rng)
        valid = rng.random(arm.n_tactels) < 0.97
        start = time.process_time_ns()
        contacts = estimator.update(readings, cycle, valid, level=level)
        took = time.process_time_ns() - start
        work = estimator.n_evaluated / arm.n_tactels
        faults = check_contacts(arm, contacts, level)
        if work > WORK_PER_TACTEL:
            faults.append(f"{work:.0f} pressures evaluated per tactel")
        result.faults += [f"seed {seed}, cycle {cycle}, {arm.name}, {level}: {fault}" for fault in faults]
        result.n += 1
        result.n_contacts += len(contacts)
        result.most_contacts = max(result.most_contacts, len(contacts))
        result.most_work = max(result.most_work, work)
        result.most_ms = max(result.most_ms, 1e-6 * took)
        if done is not None and cycle % 1000 == 999:
            done(1000)
    return result
