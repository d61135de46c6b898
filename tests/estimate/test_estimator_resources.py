"""How the estimator runs: in memory that does not grow, and without Python's lock."""

import ctypes
import gc
import itertools
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from numba import cfunc, types
from numba.core.errors import NumbaError

from skinbus.estimate import Baseline, Clock, Estimator, Tracker
from skinbus.estimate.budget import DEADLINE
from skinbus.jit import kernel
from skinbus.model import Cone
from tests.cli.patience import TRIES
from tests.run_in_process import run_in_process
from tests.skins import cone_forearm

TOUCHES = [(0.025, 0.0), (0.0255, 0.1275), (0.051, -0.1), (0.077, 0.0765), (0.128, -0.05)]
"""(s, a) in m: two on seams, three inside patches."""
CYCLES = 10_000
STRAY = 128 * 1024
"""Bytes that Python and numba may hold more at the end than before: strings of some 57 bytes, 40 kB of them
at most, no more after 10^5 cycles than after 10^4. One small object in each cycle would be 280 kB."""


def film(arm):
    """(64, n_tactels) Pa: five touches that come and go, with noise; seed 41."""
    print("seed 41")
    rng, law = np.random.default_rng(41), Cone()
    each = np.array([law.pressure(arm.distance(slice(None), *t), 8.0) for t in TOUCHES])
    shown = rng.random((64, len(TOUCHES))) < 0.8
    return shown @ each + 200.0 * rng.standard_normal((64, arm.n_tactels))


def memory_of_cycles():
    """Return None, or by how many bytes traced and resident memory grows in each ten thousand cycles."""
    arm, cycle, grown = cone_forearm(), itertools.count(1), []
    shown = film(arm)
    estimator, tracker, baseline = Estimator(arm, "full"), Tracker(arm), Baseline(arm)
    pressures = np.zeros(arm.n_tactels)

    def held_after(cycles):
        for n in itertools.islice(cycle, cycles):
            pressures[:] = shown[n % len(shown)]
            baseline.apply(pressures, 20_000_000 * n)
            tracker.update(estimator.update(pressures, 20_000_000 * n, baseline=baseline), 20_000_000 * n)
        gc.collect()
        resident = 4096 * int(Path("/proc/self/statm").read_text().split()[1])
        return np.array([tracemalloc.get_traced_memory()[0], resident])

    held_after(1000)
    tracemalloc.start()
    before = held_after(200)  # tracing has its own beginnings
    for _ in range(TRIES):  # the system may hold more at one time, a leak does so each time
        after = held_after(CYCLES)
        traced, resident = after - before
        # a leak of one byte in each cycle would not show; one small object, or one array, would
        if traced < STRAY and resident < 32 * CYCLES:
            return None
        grown.append((int(traced), int(resident)))
        before = after
    return grown


@pytest.mark.slow  # test_kernels_cannot_allocate is the reason, and quick
def test_ten_thousand_cycles_leave_memory_as_it_was():
    """In a process of its own: threads and caches of other tests come and go when they like."""
    assert run_in_process(memory_of_cycles) is None


holds_lock = types.ExternalFunction("PyGILState_Check", types.int32())


@cfunc("int32(int32, CPointer(int64))")
def lock_as_time(clock_id, answer):
    """A clock that says 1 ns while its thread holds Python's lock, and 0 while it does not."""
    answer[0] = 0
    answer[1] = holds_lock()
    return 0


@pytest.mark.parametrize("level", ["kmeans", "full"])
def test_kernels_run_without_pythons_lock(level):
    assert read_with_lock() == 1
    arm = cone_forearm()
    estimator = Estimator(arm, level, clock=Clock(lock_as_time.address))
    estimator.update(film(arm)[0], 0, budget_us=1e6)
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
