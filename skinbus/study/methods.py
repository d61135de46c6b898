"""What turns pressures into contacts in the study: our levels, and what a user would otherwise pick.

The others get what they lack as a present: the number of touches, and which tactels are touched. They
cluster the places of touched tactels; the place of a contact is then the pressure-weighted centroid, its
force the mean of what the contact law says for each of its tactels, weighted by pressure.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import LEVELS, Estimator
from skinbus.model import Arm
from skinbus.study.cases import THRESHOLD

Floats = npt.NDArray[np.float64]

SCIPY_KMEANS: Final = "scipy kmeans2"
SKLEARN_KMEANS: Final = "scikit-learn KMeans"
SCIPY_FIT: Final = "scipy least_squares"
PAPER: Final = "paper's K-means"
"""Level ``kmeans`` with the paper's random start."""
OTHERS: Final = (PAPER, SCIPY_KMEANS, SKLEARN_KMEANS, SCIPY_FIT)

Method = Callable[[Floats], Floats]
"""Pressures (n_tactels,) Pa to contacts (n, 3): s, a in m, force in N."""


def methods_here() -> tuple[str, ...]:
    """Return the methods that this machine has the packages for."""
    others = [m for m in OTHERS if m != SKLEARN_KMEANS or find_spec("sklearn") is not None]
    return (*LEVELS, *others)


def make_method(
    name: str, arm: Arm, *, n_touches: int, iterations: int = 0, budget: int = 0, seed: int = 0
) -> Method:
    """Return a method by its name; ``iterations`` (0: to the end) bounds those that can be bounded.

    ``budget`` (0: none) bounds the work of a level of ours.

    Raises:
        ValueError: an unknown name, or iterations of a method that has no such bound.
    """
    if name in LEVELS:
        if iterations:
            raise ValueError(f"level {name} has no bound on iterations; leave iterations at 0")
        return _level(name, arm, budget)
    if budget:
        raise ValueError(f"{name} has no budget; leave budget at 0")
    if name == PAPER and not iterations:
        return _level("kmeans", arm, start="random", seed=seed)
    places = np.column_stack([arm.tactel_s, arm.tactel_a])
    if name == SCIPY_KMEANS:
        return _scipy_kmeans(arm, places, n_touches, iterations or 10, seed)
    if name == SKLEARN_KMEANS:
        return _sklearn_kmeans(arm, places, n_touches, iterations or 300, seed)
    if name == SCIPY_FIT:
        return _scipy_fit(arm, iterations or 50)
    raise ValueError(f"no method {name!r}; known are {', '.join((*LEVELS, *OTHERS))}")


def _level(name: str, arm: Arm, budget: int = 0, *, start: str = "maxima", seed: int = 0) -> Method:
    estimator = Estimator(arm, name, budget_work=budget or None, start=start, seed=seed)

    def run(pressures: Floats) -> Floats:
        contacts = estimator.update(pressures, 0)
        return np.column_stack([contacts.s, contacts.a, contacts.force])

    return run


def _scipy_kmeans(arm: Arm, places: Floats, k: int, rounds: int, seed: int) -> Method:
    from scipy.cluster.vq import kmeans2

    rng = np.random.default_rng(seed)

    def run(pressures: Floats) -> Floats:
        active = np.flatnonzero(pressures > THRESHOLD)
        if len(active) < k:
            return np.empty((0, 3))
        starts = places[rng.choice(active, k, replace=False)]
        _, labels = kmeans2(places[active], starts, iter=rounds, minit="matrix")
        return _of_clusters(arm, places, active, labels, pressures, k)

    return _quietly(run)


def _sklearn_kmeans(arm: Arm, places: Floats, k: int, rounds: int, seed: int) -> Method:
    from sklearn.cluster import KMeans

    clusters = KMeans(k, n_init=1, max_iter=rounds, random_state=seed)

    def run(pressures: Floats) -> Floats:
        active = np.flatnonzero(pressures > THRESHOLD)
        if len(active) < k:
            return np.empty((0, 3))
        labels = clusters.fit_predict(places[active], sample_weight=pressures[active])
        return _of_clusters(arm, places, active, labels, pressures, k)

    return _quietly(run)


def _scipy_fit(arm: Arm, evaluations: int) -> Method:
    """Return least squares of the contact law from the centroids of level ``kmeans``, all tactels at once."""
    from scipy.optimize import least_squares

    start = _level("kmeans", arm)
    link, law = arm.links[0].surface, arm.patches[0].patch.law
    s, a = arm.tactel_s, arm.tactel_a

    def run(pressures: Floats) -> Floats:
        rows = start(pressures)
        if not len(rows):
            return rows
        # mm and log force: all of one size
        first = np.column_stack([1e3 * rows[:, :2], np.log(rows[:, 2])]).ravel()

        def residuals(x: Floats) -> Floats:
            tried = x.reshape(-1, 3)
            d = link.distance(1e-3 * tried[:, :1], 1e-3 * tried[:, 1:2], s, a)
            force = np.exp(np.clip(tried[:, 2:], -20.0, 10.0))
            return np.asarray((law.pressure(d, force).sum(0) - pressures) / arm.tactel_noise)

        x = least_squares(residuals, first, max_nfev=evaluations).x.reshape(-1, 3)
        return np.column_stack([1e-3 * x[:, :2], np.exp(np.clip(x[:, 2], -20.0, 10.0))])

    return run


def _of_clusters(
    arm: Arm, places: Floats, active: npt.NDArray[np.intp], labels: Any, pressures: Floats, k: int
) -> Floats:
    """Return the contacts of a partition of the touched tactels."""
    law, surface = arm.patches[0].patch.law, arm.links[0].surface
    rows = []
    for c in range(k):
        own = active[labels == c]
        if not len(own):
            continue
        p = pressures[own]
        s, a = p @ places[own] / p.sum()
        d = surface.distance(s, a, places[own, 0], places[own, 1])
        # the force of each tactel by the law, the nearer and larger the more it says
        forces = law.force(p, d)
        rows.append((s, a, float(p @ forces / p.sum())))
    return np.array(rows) if rows else np.empty((0, 3))


def _quietly(run: Method) -> Method:
    """Warnings of fewer distinct places than clusters are not the study's business."""
    import warnings

    def quiet(pressures: Floats) -> Floats:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return run(pressures)

    return quiet
