"""How the estimator runs: in memory that does not grow, and without Python's lock."""

import ctypes
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import cfunc, types
from numba.core.errors import NumbaError

from skinbus.estimate import Clock, Estimator
from skinbus.estimate.budget import DEADLINE
from skinbus.jit import kernel
from tests.estimate.memory import films
from tests.oracle import cases

ROOT = Path(__file__).parent.parent.parent


@pytest.fixture(scope="module")
def arm():
    return cases.arm()


@pytest.mark.slow  # test_kernels_cannot_allocate is the reason, and quick
def test_ten_thousand_cycles_leave_memory_as_it_was():
    """In a process of its own: threads and caches of other tests come and go when they like."""
    command = [sys.executable, "-W", "error", "-m", "tests.estimate.memory"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    print(done.stdout)
    assert done.returncode == 0, done.stderr[-2000:]


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
