"""Garbage is collected where it delays no cycle."""

import gc
from itertools import count
from types import SimpleNamespace

import pytest

from skinbus.bus.realtime import N_TOO_MANY, N_WORTH_IT, GcScheduler

MS = 1_000_000


@pytest.fixture
def collected(monkeypatch):
    """Generations as they are collected; by the clock of the loop that takes 0.1 ms."""
    reads, collected, collect = count(0, MS // 10), [], gc.collect
    monkeypatch.setattr("skinbus.bus.realtime.time", SimpleNamespace(perf_counter_ns=lambda: next(reads)))
    monkeypatch.setattr(
        gc, "collect", lambda generation=2: (collected.append(generation), collect(generation))
    )
    return collected


def test_garbage_is_collected_in_pauses_only(collected):
    with GcScheduler() as tidy:
        assert not gc.isenabled()
        garbage = [[] for _ in range(5 * N_WORTH_IT)]
        tidy.pause(0)
        assert collected == [2]  # at the beginning
        tidy.pause(1000 * MS)
        assert collected == [2, 0]
        for _ in range(30):
            garbage += [[] for _ in range(2 * N_WORTH_IT)]
            tidy.pause(1000 * MS)
        assert 1 in collected
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


def test_too_much_garbage_is_collected_even_without_a_pause(collected):
    with GcScheduler() as tidy:
        garbage = [[] for _ in range(N_TOO_MANY + 1)]
        tidy.pause(0)
        assert collected == [2, 0]
    assert garbage
