"""The budget of a cycle: work that is counted, and time by a clock that is handed in.

A kernel asks :func:`is_over` before each step that may take long, an iteration of a fit above all. Once the
answer was yes it stays so until the next cycle. Work is counted in pressures evaluated, so a budget in work
gives the same bits on every machine. Time is what a clock says whose address is handed in; a cycle without a
budget in time looks at none.
"""

from __future__ import annotations

import ctypes
import time
from typing import Any, NamedTuple

from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic

from skinbus.arrays import Ints
from skinbus.estimate.kernels.workspace import Work
from skinbus.jit import inner_kernel

MOST_PER_TACTEL, MOST_OF_ARM, MOST_OF_ANY = 150_000, 20_000, 11_000_000
"""Pressures that a cycle evaluates at most where no budget says less: the first for each tactel, or the
second for each and the third besides, whichever is less. Of nine touches on 64 tactels 97 % are counted right
with it, 93 % with two thirds; 384 tactels end after 19 million, 0.15 s."""
DONE, MOST, CLOCK, CLOCK_ID, DEADLINE = range(5)
"""Places in ``Work.work``: pressures evaluated, the most allowed, the clock (0: none), the last of its ns."""


class Clock(NamedTuple):
    """A clock that compiled code can read without Python.

    ``address`` is that of a C function like POSIX ``clock_gettime``: int (int32 id, int64 time[2]), s and ns.
    """

    address: int
    clock_id: int = 0


def monotonic_clock() -> Clock:
    """Return the monotonic clock of this machine.

    Raises:
        OSError: the C library has no ``clock_gettime``.
    """
    try:
        function = ctypes.CDLL(None).clock_gettime
    except (AttributeError, TypeError) as error:  # TypeError: Windows needs a name
        raise OSError("this machine has no clock_gettime; give the estimator a clock") from error
    address = ctypes.cast(function, ctypes.c_void_p).value
    assert address is not None  # a function that was found has one
    return Clock(address, time.CLOCK_MONOTONIC)


MONOTONIC = monotonic_clock() if hasattr(time, "CLOCK_MONOTONIC") else None
"""The same for a default argument: None where there is none."""


def most_work(n_tactels: int) -> int:
    """Return the pressures that a cycle of an arm evaluates at most, whatever its readings."""
    return min(MOST_PER_TACTEL * n_tactels, MOST_OF_ARM * n_tactels + MOST_OF_ANY)


def set_budget(
    work: Ints,
    n_tactels: int,
    clock: Clock | None,
    budget_us: float | None,
    budget_work: int | None,
) -> None:
    """Write the budget of the next cycle; the time begins with the kernel that calls :func:`begin`."""
    most = most_work(n_tactels)
    work[DONE] = 0
    work[MOST] = most if budget_work is None else min(budget_work, most)
    work[CLOCK] = 0
    if budget_us is not None and clock is not None:
        work[CLOCK], work[CLOCK_ID] = clock
        work[DEADLINE] = round(1000 * budget_us)


@inner_kernel
def begin(w: Work) -> None:
    """Begin the time of a cycle: what was a budget becomes a deadline."""
    if w.work[CLOCK] != 0:
        w.work[DEADLINE] += now(w.work)


@inner_kernel
def is_over(w: Work) -> bool:
    """Return whether work or time is used up."""
    work = w.work
    if work[DONE] >= work[MOST]:
        return True
    if work[CLOCK] != 0 and now(work) >= work[DEADLINE]:
        work[MOST] = -1  # it stays over: the clock is not read again
        return True
    return False


@inner_kernel
def now(work: Ints) -> int:
    """Return what the clock of a budget says, ns."""
    nanoseconds: int = read_clock(work[CLOCK], work[CLOCK_ID])
    return nanoseconds


def read_clock_plainly(address: int, clock_id: int) -> int:
    """Return the time of the clock at an address, ns, where kernels run uncompiled."""
    seconds_and_rest = (ctypes.c_int64 * 2)()
    function = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int32, ctypes.c_void_p)(int(address))
    function(int(clock_id), seconds_and_rest)
    return 10**9 * seconds_and_rest[0] + seconds_and_rest[1]


@intrinsic
def read_clock_compiled(typing_context: Any, address: Any, clock_id: Any) -> Any:
    """Return the time of the clock at an address, ns; 22 ns for a Linux that has a vDSO."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        int32, int64 = ir.IntType(32), ir.IntType(64)
        pair = ir.ArrayType(int64, 2)
        function = builder.inttoptr(args[0], ir.FunctionType(int32, [int32, pair.as_pointer()]).as_pointer())
        with builder.goto_entry_block():  # not within a loop: it would grow the stack
            answer = builder.alloca(pair)
        builder.call(function, [builder.trunc(args[1], int32), answer])
        seconds = builder.extract_value(builder.load(answer), 0)
        rest = builder.extract_value(builder.load(answer), 1)
        return builder.add(builder.mul(seconds, ir.Constant(int64, 10**9)), rest)

    return types.int64(types.int64, types.int64), generate


read_clock: Any = read_clock_plainly if getattr(config, "DISABLE_JIT", 0) else read_clock_compiled
