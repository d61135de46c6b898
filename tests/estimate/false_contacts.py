"""Counts false contacts of a quiet forearm: python -m tests.estimate.false_contacts [CYCLES]; seed 7.

Noise of 200 Pa on 384 tactels at 50 Hz, the default threshold, for every level, with and without a baseline.
10^6 cycles, five and a half hours of 50 Hz, take some minutes.
"""

import sys

import numpy as np

from skinbus.estimate import LEVELS, Baseline, Estimator
from tests.oracle import cases

SIGMA = 200.0
PERIOD_NS = 20_000_000
BLOCK = 1000


def count_false(level, n_cycles, *, told, seed=7):
    """Return (cycles with a contact, contacts) of so many cycles of noise; ``told``: by a baseline."""
    arm = cases.arm()
    estimator = Estimator(arm, level)
    baseline = Baseline(arm) if told else None
    rng = np.random.default_rng(seed)
    block = np.zeros((BLOCK, arm.n_tactels))
    n_bad = n_contacts = 0
    for first in range(0, n_cycles, BLOCK):
        rng.standard_normal(out=block)
        block *= SIGMA
        for k in range(min(BLOCK, n_cycles - first)):
            t_ns = PERIOD_NS * (first + k + 1)
            if baseline is not None:
                baseline.apply(block[k], t_ns)
            n = len(estimator.update(block[k], t_ns, baseline=baseline))
            n_bad += n > 0
            n_contacts += n
    return n_bad, n_contacts


def main():
    n_cycles = int(float(sys.argv[1])) if len(sys.argv) > 1 else 10**6
    for told in (False, True):
        for level in LEVELS:
            n_bad, n_contacts = count_false(level, n_cycles, told=told)
            words = "with a baseline" if told else "without"
            print(
                f"{level}, {words}: {n_contacts} false contacts in {n_bad} of {n_cycles} cycles", flush=True
            )


if __name__ == "__main__":
    main()
