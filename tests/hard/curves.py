"""How error and reported standard deviation grow as a case gets harder."""

import math
from types import SimpleNamespace

import numpy as np

from skinbus.estimate import Estimator
from skinbus.model import grid
from tests.hard.ground import NOISE, PITCH, Ground, distance_to, pressures_under, touch

GROUND = Ground("plane", "radial")
FAMILIES = {
    # across the line the place is lost in the end
    "line": (
        "two rows of tactels come together: their distance, mm",
        (16e-3, 8e-3, 4e-3, 2e-3, 1e-3, 0.5e-3, 0.2e-3, 0.05e-3, 1e-5, 1e-7),
        lambda x: (grid(6, 2, 8e-3) * [1.0, x / 8e-3], [(0.001, 0.002, 5.0)]),
    ),
    "pair": (
        "two touches come together: their distance, mm",
        (30e-3, 25e-3, 20e-3, 16e-3, 13e-3, 10e-3, 8e-3, 6e-3, 4e-3, 2e-3, 1e-3, 1e-4),
        lambda x: (grid(4, 4, PITCH), [(-0.5 * x, 0.001, 6.0), (0.5 * x, 0.001, 6.0)]),
    ),
    "edge": (
        "a touch leaves the tactels: distance from the last row, mm",
        (0.1e-3, 2e-3, 4e-3, 6e-3, 8e-3, 10e-3, 11e-3, 12e-3, 13e-3, 14e-3),
        lambda x: (grid(4, 4, PITCH), [(0.001, 0.015 + x, 20.0)]),
    ),
}
"""What changes, how far (m), and the tactels and touches (u, v, force) of one board then."""


def measure_point(family, level, hardness, trials, seed):
    """What many answers to one case gave: root mean squares of the error and of what is reported for it.

    The error is the distance of the first touch from the nearest contact; of the middle of all touches, where
    one contact answers several.
    """
    uv, spots = FAMILIES[family][2](hardness)
    arm = GROUND.board(uv)
    clean = pressures_under(arm, [touch(arm, 0, *spot) for spot in spots])
    estimator, rng, rows = Estimator(arm, level), np.random.default_rng(seed), []
    for t_ns in range(trials):
        contacts = estimator.update(clean + NOISE * rng.standard_normal(arm.n_tactels), t_ns)
        if len(contacts):
            watched = spots[0] if len(contacts) >= len(spots) else np.mean(spots, axis=0)
            d = distance_to(arm, touch(arm, 0, *watched), contacts)
            c = int(d.argmin())
            rows.append((d[c], math.sqrt(np.linalg.eigvalsh(contacts.covariance[c, :2, :2])[-1])))
    table = 1e3 * np.array(rows)
    error, sigma = np.sqrt((table**2).mean(axis=0))
    return SimpleNamespace(
        hardness=hardness,
        error_mm=error,
        sigma_mm=sigma,
        dishonest=np.mean(table[:, 0] > 6.0 * table[:, 1]),
        found=len(rows) / trials,
    )
