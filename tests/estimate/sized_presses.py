"""Presses of discs on boards with the law that ships, and the least error that a known law would have there.

`python -m tests.estimate.sized_presses [SEED [CASES]]` prints a line per board and size.
"""

import sys

import numpy as np

from skinbus.estimate import Estimator, Quality
from skinbus.model import Arm, Link, PlacedPatch, Surface
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from skinbus.sim.laws import Elastic
from skinbus.study.skin_models import feel_of

GAINS = 0.03
SIZES_MM = (2.0, 4.0, 8.0, 12.0, 18.0, 25.0)
SIZE_SD = 23e-3 / np.sqrt(12.0)
"""m: sizes of 2 to 25 mm, each as likely as any other."""
STEP = 0.25e-3
NORMAL_MEDIAN = 0.67448975


class SizedPresses:
    """One disc within the hull of a board of rubber that nobody has calibrated: pressures, and the bound."""

    def __init__(self, size_mm, eds="skin-patch"):
        patch = describe_patch(load_eds(eds, 1))
        width, height = patch.size
        link = Link("board", Surface.plane(width, height))
        place = PlacedPatch(patch=patch, node_id=1, link=0, s=0.5 * width, a=0.0)
        self.arm = Arm("board", [link], [place])
        self.noise = float(self.arm.tactel_noise[0])
        radius = 0.5e-3 * size_mm
        self._feel = feel_of(self.arm, Elastic(), radius)
        self._larger = feel_of(self.arm, Elastic(), radius + STEP)
        self._smaller = feel_of(self.arm, Elastic(), radius - STEP)

    def draw(self, rng):
        """Return s, a (m) and force (N) of a touch."""
        arm = self.arm
        return np.array(
            [
                rng.uniform(arm.tactel_s.min(), arm.tactel_s.max()),
                rng.uniform(arm.tactel_a.min(), arm.tactel_a.max()),
                rng.uniform(2.0, 20.0),
            ]
        )

    def clean(self, touch):
        """Return (n_tactels,) Pa without noise."""
        return self._feel(touch[None])

    def press(self, touch, rng):
        """Return (n_tactels,) Pa with noise, and gains that are not told."""
        gain = 1.0 + GAINS * rng.standard_normal(self.arm.n_tactels)
        return self._feel(touch[None]) * gain + self.noise * rng.standard_normal(self.arm.n_tactels)

    def bound(self, touch):
        """Return the covariance (3, 3) of s, a, force at the Cramer-Rao bound with the size unknown."""
        columns = []
        for i, step in enumerate((1e-5, 1e-5, 1e-3 * touch[2])):
            up, down = touch.copy(), touch.copy()
            up[i] += step
            down[i] -= step
            columns.append((self._feel(up[None]) - self._feel(down[None])) / (2.0 * step))
        columns.append((self._larger(touch[None]) - self._smaller(touch[None])) / (4.0 * STEP))
        jacobian = np.stack(columns, -1)
        weight = 1.0 / (self.noise**2 + (GAINS * self._feel(touch[None])) ** 2)
        information = jacobian.T @ (weight[:, None] * jacobian)
        information[3, 3] += SIZE_SD**-2.0
        scale = np.sqrt(np.diag(information))
        return (np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale))[:3, :3]

    def measure(self, level, n, seed):
        """Return the mean NEES per degree of freedom, ratios of place and force to the bound, answers used.

        Only contacts that are determined count: few tactels have a covariance of their own.
        """
        rng, estimator = np.random.default_rng(seed), Estimator(self.arm, level)
        ideals = np.random.default_rng([seed, 1])  # presses are the same, whatever is flagged
        nees, place, force, ideal = [], [], [], []
        for k in range(n):
            touch = self.draw(rng)
            contacts = estimator.update(self.press(touch, rng), k)
            if len(contacts) != 1 or contacts.quality[0] & Quality.FEW_TACTELS:
                continue
            error = np.array([contacts.s[0], contacts.a[0], contacts.force[0]]) - touch
            nees.append(error @ np.linalg.solve(contacts.covariance[0], error) / 3.0)
            least = self.bound(touch)
            away = np.sqrt(least[0, 0] + least[1, 1])
            place.append(np.hypot(*error[:2]) / away)
            force.append(abs(error[2]) / np.sqrt(least[2, 2]))
            drawn = ideals.multivariate_normal(np.zeros(2), least[:2, :2], 40)
            ideal += (np.hypot(*drawn.T) / away).tolist()
        return (
            float(np.mean(nees)),
            float(np.median(place) / np.median(ideal)),
            float(np.median(force) / NORMAL_MEDIAN),
            len(nees),
        )


def main():
    seed = int(sys.argv[1]) if len(sys.argv) > 1 else 7000
    n = int(sys.argv[2]) if len(sys.argv) > 2 else 300
    for eds in ("skin-patch", "skin-patch-8x8"):
        for size in SIZES_MM:
            presses = SizedPresses(size, eds)
            for level in ("fit", "full"):
                nees, place, force, used = presses.measure(level, n, seed)
                print(
                    f"{eds} {size:4g} mm {level:4s}  NEES {nees:6.2f}  used {used} of {n}"
                    f"  place {place:.2f}  force {force:.2f} times the bound",
                    flush=True,
                )


if __name__ == "__main__":
    main()
