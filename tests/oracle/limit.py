"""Statistics of an estimator against the Cramer-Rao bound, case by case."""

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from tests.oracle.crb import bound, ideal_median
from tests.oracle.fields import pressures_of

SLACK = 1.06
"""The median of 400 ratios scatters by 3 % (one standard deviation, two for a hundred tests)."""

SIGMA = 200.0
"""1 % of the peak of a 5 N contact under the cone of 1.2 MPa/m, Pa."""
REACHED = 3
"""Tactels that a contact must bring to their threshold; cases with fewer are excluded and counted."""


@dataclass
class Tally:
    """What a series of cases gave."""

    n_cases: int = 0
    n_excluded: int = 0
    counts: dict = field(default_factory=dict)
    position: list = field(default_factory=list)
    """|error| in m where the count was right."""
    force: list = field(default_factory=list)
    """Relative errors."""
    position_ratio: list = field(default_factory=list)
    force_ratio: list = field(default_factory=list)
    bounds: list = field(default_factory=list)
    nees: list = field(default_factory=list)
    """Normalised error squared of (s, a, force) by the reported covariance: 3 degrees of freedom."""
    wrong: list = field(default_factory=list)

    def right(self, n):
        """Part of the cases in which n contacts were reported."""
        return self.counts.get(n, 0) / max(self.n_cases, 1)

    def ratios(self, rng):
        """Ratio to the bound of the median errors of position and force."""
        place, force = ideal_median(self.bounds[:2000], rng)
        return float(np.median(self.position_ratio)) / place, float(np.median(self.force_ratio)) / force


def run(estimator, draw, field_of, n_cases, rng, *, sigma=SIGMA, true_arm=None, read=None):
    """Return the Tally of ``n_cases`` cases; ``draw(rng)`` gives the touches (link, s, a, force) of one.

    ``true_arm`` is the arm that feels; ``read`` turns pressures with noise into what is read.
    """
    arm = estimator.arm
    true_arm = true_arm or arm
    tally = Tally()
    while tally.n_cases < n_cases:
        touches = draw(rng)
        clean = [pressures_of(true_arm, [touch], field_of) for touch in touches]
        if min((each >= arm.tactel_threshold).sum() for each in clean) < REACHED:
            tally.n_excluded += 1
            continue
        tally.n_cases += 1
        pressures = sum(clean) + sigma * rng.standard_normal(arm.n_tactels)
        if read is not None:
            pressures = read(pressures)
        contacts = estimator.update(pressures, tally.n_cases * 20_000_000)
        tally.counts[len(contacts)] = tally.counts.get(len(contacts), 0) + 1
        if len(contacts) != len(touches):
            tally.wrong.append((touches, contacts))
            continue
        surface = arm.links[0].surface
        distance = np.array([surface.distance(t[1], t[2], contacts.s, contacts.a) for t in touches])
        rows, columns = linear_sum_assignment(distance)
        bounds = bound(true_arm, touches, field_of, np.full(arm.n_tactels, sigma))
        for row, column in zip(rows, columns, strict=True):
            _, s, a, force = touches[row]
            error = np.array(
                [
                    contacts.s[column] - s,
                    float(surface.wrap(contacts.a[column] - a)),
                    contacts.force[column] - force,
                ]
            )
            tally.position.append(distance[row, column])
            tally.force.append(error[2] / force)
            if contacts.covariance[column].any():
                tally.nees.append(float(error @ np.linalg.solve(contacts.covariance[column], error)))
            if bounds is not None:
                tally.bounds.append(bounds[row])
                tally.position_ratio.append(distance[row, column] / np.sqrt(np.trace(bounds[row][:2, :2])))
                tally.force_ratio.append(abs(error[2]) / np.sqrt(bounds[row][2, 2]))
    return tally
