"""Presses by a person on the board "pad", as a file: ``python -m tests.cli.simulated_presses FILE``.

Tactels differ as those of real boards do; one has a gain and another a noise that no healthy one has, and
three presses are not where they are said to be.
"""

import csv
import sys

import numpy as np

from skinbus.config.system import load_arm
from skinbus.study.arm_study import Truth

PRESSES = 160
LOUD, FAINT = 9, 5
"""Tactels, from 0, of much noise and of much too small a reading."""
MOVED = (40, 77, 120)
"""Rows of presses that are 6 mm off."""


def main(file: str) -> None:
    """Write the presses."""
    arm, rng = load_arm("pad"), np.random.default_rng(4)
    truth, step = Truth(arm, 0.0), arm.patches[0].patch.transducer.step
    gain = 1.0 + 0.08 * rng.standard_normal(arm.n_tactels)
    noise = np.full(arm.n_tactels, 120.0)
    gain[FAINT], noise[LOUD] = 0.6, 700.0
    middle = np.array([arm.tactel_s.mean(), arm.tactel_a.mean()])
    with open(file, "w", newline="") as out:
        rows = csv.writer(out)
        rows.writerow(["node_id", "s_mm", "a_mm", "force_n", *(f"c{k + 1}" for k in range(arm.n_tactels))])
        for k in range(PRESSES):
            s, a = middle + rng.uniform(-0.02, 0.02, 2)
            force = float(np.exp(rng.uniform(np.log(2.0), np.log(12.0))))
            pressures = truth.feel(np.array([[s, a, force]]), 0, 1, 0.0) * gain
            counts = np.rint((pressures + noise * rng.standard_normal(arm.n_tactels)) / step).astype(int)
            said = s + (6e-3 if k in MOVED else 0.0)
            place = [f"{1e3 * said:.2f}", f"{1e3 * a:.2f}", f"{force:.3f}"]
            rows.writerow([arm.patches[0].node_id, *place, *counts.tolist()])


if __name__ == "__main__":
    main(sys.argv[1])
