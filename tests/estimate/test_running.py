"""How the estimator runs: in memory that does not grow, and without Python's lock."""

import ctypes
import gc
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from numba import cfunc, types
from numba.core.errors import NumbaError

from skinbus.estimate import Baseline, Clock, Estimator, Tracker
from skinbus.estimate.budget import DEADLINE
from skinbus.estimate.kernel import kernel
from skinbus.model import Cone
from tests.oracle import cases

TOUCHES = [(0.025, 0.0), (0.0255, 0.1275), (0.051, -0.1), (0.077, 0.0765), (0.128, -0.05)]
"""(s, a) in m: two on seams, three inside patches."""
PERIOD_NS = 20_000_000
CYCLES = 10_000
PAGE = 4096
STRAY = 16 * 1024
"""Bytes that Python itself may hold more at the end than before: caches of small objects."""


@pytest.fixture(scope="module")
def arm():
    return cases.arm()


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


def test_ten_thousand_cycles_leave_memory_as_it_was(arm):
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
    try:
        run(1001, 200)  # tracing has its own beginnings
        gc.collect()
        before, resident_before = tracemalloc.get_traced_memory()[0], resident()
        assert run(1201, CYCLES) > 4 * CYCLES
        gc.collect()
        after, resident_after = tracemalloc.get_traced_memory()[0], resident()
    finally:
        tracemalloc.stop()
    print(f"{CYCLES} cycles: {after - before} bytes traced, {resident_after - resident_before} resident")
    assert after - before < STRAY
    # a leak of one byte in each cycle would not show; one small object, or one array, would
    assert resident_after - resident_before < 32 * CYCLES


holds_lock = types.ExternalFunction("PyGILState_Check", types.int32())


@cfunc("int32(int32, CPointer(int64))")
def lock_as_time(clock_id, answer):
    """A clock that says 1 ns while its thread holds Python's lock, and 0 while it does not."""
    answer[0] = 0
    answer[1] = holds_lock()
    return 0


@pytest.mark.parametrize("level", ["kmeans", "full"])
def test_kernels_run_without_pythons_lock(arm, level):
    assert read_with_lock() == 1
    estimator = Estimator(arm, level, clock=Clock(lock_as_time.address))
    estimator.update(films(arm)[0], 0, budget_us=1e6)
    assert estimator._work.work[DEADLINE] == 10**9  # the budget, and the time at which it began: 0


def read_with_lock():
    """What the clock says to a caller that holds the lock."""
    seen = (ctypes.c_int64 * 2)()
    prototype = ctypes.PYFUNCTYPE(ctypes.c_int32, ctypes.c_int32, ctypes.c_void_p)
    prototype(lock_as_time.address)(0, ctypes.addressof(seen))
    return seen[1]


def test_kernels_cannot_allocate():
    @kernel
    def greedy(n):
        return np.zeros(n).sum()

    with pytest.raises(NumbaError, match="zeros"):
        greedy(3)
