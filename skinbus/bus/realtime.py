"""What keeps a loop on time: priority, memory that stays in, garbage collected in pauses only."""

from __future__ import annotations

import ctypes
import gc
import os
import time
from collections.abc import Iterator
from typing import Self

PRIORITY = 50
"""Of SCHED_FIFO: above ordinary work, level with the kernel's own interrupt threads (their default is 50)."""

_MCL_ALL = 1 | 2 | 4  # current and future pages, each when it is first touched (sys/mman.h)
N_WORTH_IT = 700
"""Objects allocated since the last collection from which on one is worth its time (Python's default)."""

N_TOO_MANY = 100_000
"""Objects at which a collection is made, pause or no pause: 10 MB or so."""

MARGIN_NS = 1_000_000
"""Kept free of a pause: the kernel's timer and the first frames of a cycle come when they come."""

DECAY = 64
"""Pauses passed by in which the longest time of a collection falls to 1/e: a second or so of cycles."""


def take_priority() -> Iterator[str]:
    """Put the calling thread before others and lock the process's memory; yields what was not allowed."""
    if os.sched_getscheduler(0) not in (os.SCHED_FIFO, os.SCHED_RR):
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
        except OSError as error:
            yield f"no real-time priority ({error.strerror}): cycles may come late when the machine is busy"
    if ctypes.CDLL(None, use_errno=True).mlockall(_MCL_ALL):
        yield f"memory is not locked ({os.strerror(ctypes.get_errno())}): the system may swap it out"


class GcScheduler:
    """No garbage collection while it is open, except by ``pause``, and of nothing that existed before."""

    def __init__(self) -> None:
        self._longest_ns = [0, 0, 0]

    def __enter__(self) -> Self:
        gc.collect()
        gc.freeze()
        gc.disable()
        return self

    def __exit__(self, *exc: object) -> None:
        gc.enable()
        gc.unfreeze()

    def pause(self, left_ns: int) -> None:
        """Use a pause of so many nanoseconds: collect what fits into it, by the times that it took so far."""
        n, *younger = gc.get_count()
        if n < N_WORTH_IT:
            return
        generation = 0
        for older, n_since in enumerate(
            younger, 1
        ):  # a tenth of the collections looks one generation further
            if n_since >= 10 and left_ns > 2 * self._longest_ns[older] + MARGIN_NS:
                generation = older
        if left_ns < 2 * self._longest_ns[generation] + MARGIN_NS and n < N_TOO_MANY:
            # One that was held up by a busy machine no longer counts after a while.
            self._longest_ns[generation] -= self._longest_ns[generation] // DECAY
            return
        begin_ns = time.perf_counter_ns()
        gc.collect(generation)
        took_ns = time.perf_counter_ns() - begin_ns
        self._longest_ns[generation] = max(self._longest_ns[generation], took_ns)
