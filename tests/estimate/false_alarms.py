"""False alarms: `python -m tests.estimate.false_alarms 1000000 100000` runs a forearm, idle and touched."""

import sys

import numpy as np

from tests.estimate.judged_skin import NO_TOUCH, N, Skin, press_at


def idle(cycles):
    """Return how many cycles named a tactel or withheld a board while nothing touched the skin."""
    skin, n = Skin(101), 0
    for _ in range(cycles):
        skin.read()
        n += bool((skin.plausibility.n_faulty > 0).any() or skin.plausibility.is_withheld.any())
    return n


def touched(cycles):
    """Count them under one to three contacts of 2 to 30 N, 0.1 to 1 s."""
    skin, n = Skin(102), 0
    skin.read(cycles=60)
    while skin.cycle < cycles:
        at = skin.rng.integers(N, size=skin.rng.integers(1, 4))
        touch = np.sum([press_at(i, skin.rng, 0.02) for i in at], axis=0)
        for pressures in (touch, NO_TOUCH):
            for _ in range(skin.rng.integers(5, 50)):
                skin.read(pressures)
                n += bool((skin.plausibility.n_faulty > 0).any() or skin.plausibility.is_withheld.any())
    return n


if __name__ == "__main__":
    for name, run, cycles in zip(("idle", "touched"), (idle, touched), sys.argv[1:], strict=False):
        print(f"{name}: {run(int(cycles))} cycles of {cycles} with a false alarm", flush=True)
