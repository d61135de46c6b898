"""Memory of 10^4 cycles, in a process that does nothing else; exits with 1 when it grows.

Run by ``test_estimator_resources``: `python -m tests.estimate.memory`.
"""

import gc
import sys
import tracemalloc
from pathlib import Path

import numpy as np

from skinbus.estimate import Baseline, Estimator, Tracker
from skinbus.model import Cone
from tests.cli.patience import TRIES
from tests.oracle import cases

TOUCHES = [(0.025, 0.0), (0.0255, 0.1275), (0.051, -0.1), (0.077, 0.0765), (0.128, -0.05)]
"""(s, a) in m: two on seams, three inside patches."""
PERIOD_NS = 20_000_000
CYCLES = 10_000
PAGE = 4096
STRAY = 128 * 1024
"""Bytes that Python and numba may hold more at the end than before: strings of some 57 bytes, 40 kB of them
at most, no more after 10^5 cycles than after 10^4. One small object in each cycle would be 280 kB."""


def films(arm):
    """(64, n_tactels) Pa: five touches that come and go, with noise; seed 41."""
    print("seed 41")
    rng, law, surface = np.random.default_rng(41), Cone(), arm.links[0].surface
    each = np.array([law.pressure(surface.distance(arm.tactel_s, arm.tactel_a, *t), 8.0) for t in TOUCHES])
    shown = rng.random((64, len(TOUCHES))) < 0.8
    return shown @ each + 200.0 * rng.standard_normal((64, arm.n_tactels))


def resident():
    """Bytes of this process that are in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE


def main():
    """Return whether memory has grown."""
    arm = cases.arm()
    film = films(arm)
    estimator, tracker, baseline = Estimator(arm, "full"), Tracker(arm), Baseline(arm)
    pressures = np.zeros(arm.n_tactels)

    def run(first, n):
        seen = 0
        for cycle in range(first, first + n):
            t_ns = PERIOD_NS * cycle
            pressures[:] = film[cycle % len(film)]
            baseline.apply(pressures, t_ns)
            contacts = estimator.update(pressures, t_ns, baseline=baseline)
            seen += len(tracker.update(contacts, t_ns))
        return seen

    run(1, 1000)
    gc.collect()
    tracemalloc.start()
    run(1001, 200)  # tracing has its own beginnings
    gc.collect()
    for k in range(TRIES):  # the system may hold more at one time, a leak does so each time
        before, resident_before = tracemalloc.get_traced_memory()[0], resident()
        seen = run(1201 + k * CYCLES, CYCLES)
        gc.collect()
        grown, more_resident = tracemalloc.get_traced_memory()[0] - before, resident() - resident_before
        print(f"{CYCLES} cycles, {seen} contacts: {grown} bytes traced, {more_resident} resident")
        # a leak of one byte in each cycle would not show; one small object, or one array, would
        if seen > 4 * CYCLES and grown < STRAY and more_resident < 32 * CYCLES:
            return False
    return True


if __name__ == "__main__":
    sys.exit(main())
