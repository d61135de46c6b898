"""A source is followed cycle by cycle, and opened again when it has ended."""

import threading

import pytest

from skinbus.errors import ShareError
from skinbus.view.web.follower import Follower, History
from tests.cli.patience import PATIENCE_S, wait_until
from tests.view.web.cycles import made_cycle


def test_forces_are_the_largest_of_each_tenth_of_a_second():
    history = History()
    for n in range(1, 101):
        history.take(made_cycle(n, [{"id": 9, "force": 0.1 * n}]))
    times, ids, forces = history.forces(4)
    assert ids == [9]
    assert times[-1] == 0.0
    assert forces[-1, 0] == pytest.approx(10.0)
    assert forces[-3, 0] == pytest.approx(9.4)
    assert not forces[:-21].any()


class Source:
    """A skin that has these cycles."""

    pace = 1.0

    def __init__(self, *cycles, error=None):
        self._cycles, self._error = cycles, error
        self.zeroed, self.n_closed = [], 0

    def __iter__(self):
        yield from self._cycles
        if self._error:
            raise self._error

    def zero(self, patch):
        self.zeroed.append(patch)

    def close(self):
        self.n_closed += 1


def test_source_that_ends_is_over():
    source = Source(made_cycle(1), made_cycle(2))
    follower = Follower(lambda: source)
    wait_until(lambda: follower.has_ended)
    assert (follower.n_cycles, follower.newest.number, follower.error) == (2, 2, None)
    follower.zero(3)
    follower.close()
    assert (source.zeroed, source.n_closed) == ([3], 1)


def test_a_slow_simulation_is_not_silent_before_ten_of_its_own_periods():
    source = Source(made_cycle(1))
    source.pace = 0.01
    follower = Follower(lambda: source)
    wait_until(lambda: follower.has_ended)
    follower._came_s -= 5.0
    assert follower.silent_s == pytest.approx(0.05, abs=0.02)
    follower.close()


def test_source_is_opened_again_and_what_ended_it_is_forgotten_when_it_is_back():
    done = threading.Event()

    class Last(Source):
        def __iter__(self):
            yield made_cycle(1)
            done.wait(PATIENCE_S)

    sources = [Source(made_cycle(1), error=ShareError("it has died")), Last()]

    def opening():
        if not sources:
            raise ShareError("there is none")
        return sources.pop(0)

    follower = Follower(opening, again_s=0.01)
    wait_until(lambda: follower.n_opened == 2 and follower.n_cycles == 2)
    assert follower.error is None
    done.set()
    wait_until(lambda: follower.error is not None)
    assert not follower.has_ended
    follower.close()
    assert follower.has_ended
