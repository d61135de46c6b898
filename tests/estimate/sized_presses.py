"""Presses of discs on boards with the law that ships, and the least error that a known law would have there.

`python -m tests.estimate.sized_presses [SEED [CASES]]` prints a line per size.
"""

import sys

import numpy as np

from skinbus.estimate import Estimator
from skinbus.model import Arm
from skinbus.model.patch import grid
from skinbus.sim.laws import Elastic
from skinbus.study.skin_models import NOISE, feel_of, shipped_law

GAINS = 0.03
INSIDE = 0.015
SIZES_MM = (2.0, 4.0, 8.0, 12.0, 18.0, 25.0)
SIZE_SD = 23e-3 / np.sqrt(12.0)
"""m: sizes of 2 to 25 mm, each as likely as any other."""
STEP = 0.25e-3
NORMAL_MEDIAN = 0.67448975


class SizedPresses:
    """One disc on a 4 x 4 board of rubber that nobody has calibrated: pressures, and the bound there."""

    def __init__(self, size_mm):
        self.arm = Arm.single_patch(grid(4, 4, 0.010), law=shipped_law())
        radius = 0.5e-3 * size_mm
        self._feel = feel_of(self.arm, Elastic(), radius)
        self._larger = feel_of(self.arm, Elastic(), radius + STEP)
        self._smaller = feel_of(self.arm, Elastic(), radius - STEP)

    def clean(self, touch):
        """(n_tactels,) Pa without noise."""
        return self._feel(touch[None])

    def press(self, touch, rng):
        """(n_tactels,) Pa with noise, and gains that are not told."""
        gain = 1.0 + GAINS * rng.standard_normal(self.arm.n_tactels)
        return self._feel(touch[None]) * gain + NOISE * rng.standard_normal(self.arm.n_tactels)

    def bound(self, touch):
        """Covariance (3, 3) of s, a, force at the Cramer-Rao bound with the size unknown."""
        columns = []
        for i, step in enumerate((1e-5, 1e-5, 1e-3 * touch[2])):
            up, down = touch.copy(), touch.copy()
            up[i] += step
            down[i] -= step
            columns.append((self._feel(up[None]) - self._feel(down[None])) / (2.0 * step))
        columns.append((self._larger(touch[None]) - self._smaller(touch[None])) / (4.0 * STEP))
        jacobian = np.stack(columns, -1)
        weight = 1.0 / (NOISE**2 + (GAINS * self._feel(touch[None])) ** 2)
        information = jacobian.T @ (weight[:, None] * jacobian)
        information[3, 3] += SIZE_SD**-2.0
        scale = np.sqrt(np.diag(information))
        return (np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale))[:3, :3]

    def measure(self, level, n, seed):
        """Mean NEES per degree of freedom, ratios of place and force to the bound, cases with one contact."""
        rng, estimator = np.random.default_rng(seed), Estimator(self.arm, level)
        nees, place, force, ideal, single = [], [], [], [], 0
        for k in range(n):
            touch = np.array([*rng.uniform(-INSIDE, INSIDE, 2), rng.uniform(2.0, 20.0)])
            contacts = estimator.update(self.press(touch, rng), k)
            if len(contacts) != 1:
                continue
            single += 1
            error = np.array([contacts.s[0], contacts.a[0], contacts.force[0]]) - touch
            nees.append(error @ np.linalg.solve(contacts.covariance[0], error) / 3.0)
            least = self.bound(touch)
            away = np.sqrt(least[0, 0] + least[1, 1])
            place.append(np.hypot(*error[:2]) / away)
            force.append(abs(error[2]) / np.sqrt(least[2, 2]))
            drawn = rng.multivariate_normal(np.zeros(2), least[:2, :2], 40)
            ideal += (np.hypot(*drawn.T) / away).tolist()
        return (
            float(np.mean(nees)),
            float(np.median(place) / np.median(ideal)),
            float(np.median(force) / NORMAL_MEDIAN),
            single,
        )


def main():
    seed = int(sys.argv[1]) if len(sys.argv) > 1 else 7000
    n = int(sys.argv[2]) if len(sys.argv) > 2 else 300
    for size in SIZES_MM:
        presses = SizedPresses(size)
        for level in ("fit", "full"):
            nees, place, force, single = presses.measure(level, n, seed)
            print(
                f"{size:4g} mm {level:4s}  NEES {nees:6.2f}  one contact {single} of {n}"
                f"  place {place:.2f}  force {force:.2f} times the bound",
                flush=True,
            )


if __name__ == "__main__":
    main()
