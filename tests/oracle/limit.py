"""Statistics of an estimator against the Cramer-Rao bound, case by case."""

from itertools import islice
from types import SimpleNamespace

import numpy as np

from tests.bench.estimator import errors
from tests.oracle.crb import bound, ideal_median
from tests.oracle.fields import cone_field, pressures_of
from tests.skins import SkinModel, reached

SLACK = 1.06
"""The median of 400 ratios scatters by 3 % (one standard deviation, two for a hundred tests)."""
N_RATIOS = 400
"""Cases that are held against the bound."""
SIGMA = 200.0
"""1 % of the peak of a 5 N contact under the cone of 1.2 MPa/m, Pa."""


def run(estimator, draw, n_cases, rng):
    """Return what cases under the cone gave: the share with the right count, and of these the medians of the
    errors of place and force over those at the bound, and the mean error squared by the reported covariance.
    """
    arm, n_right, squares, ratios, bounds = estimator.arm, 0, [], [], []
    skin = SkinModel(arm, lambda touches: pressures_of(arm, touches, cone_field), None)
    for k, touches in enumerate(islice(reached(skin, draw, rng), n_cases)):
        c = estimator.update(skin.feel(touches) + SIGMA * rng.standard_normal(arm.n_tactels), k * 20_000_000)
        n_right += len(c) == len(touches)
        found = errors(arm.links[0].surface, touches, c.s, c.a, c.force, c.covariance, c.quality)
        squares += [square for _, _, square, _ in found]
        limits = bound(arm, touches, cone_field, SIGMA) if found and k < N_RATIOS else None
        if limits is not None:
            bounds += list(limits)
            sd = np.sqrt(np.stack([limits[:, 0, 0] + limits[:, 1, 1], limits[:, 2, 2]], -1))
            ratios += list(
                np.abs(np.array(found)[:, :2]) * np.stack([np.ones(len(found)), touches[:, 2]], -1) / sd
            )
    place, force = np.median(ratios, axis=0) / ideal_median(bounds, np.random.default_rng(9))
    return SimpleNamespace(right=n_right / n_cases, place=place, force=force, nees=np.mean(squares))
