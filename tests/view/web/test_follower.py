"""A follower counts every cycle, opens an ended source again where that is wanted, and says what ended it."""

import threading
import time

from skinbus.errors import ShareError
from skinbus.view.web.follower import Follower
from tests.cli.patience import PATIENCE_S
from tests.view.web.cycles import MadeCycle


class Source:
    """A skin that has these cycles."""

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


def until(holds):
    end = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end
        threading.Event().wait(0.002)


def test_source_that_ends_is_over():
    source = Source(MadeCycle(1), MadeCycle(2))
    follower = Follower(lambda: source)
    until(lambda: follower.has_ended)
    assert (follower.n_cycles, follower.newest.number, follower.error) == (2, 2, None)
    follower.zero(3)
    follower.close()
    assert (source.zeroed, source.n_closed) == ([3], 1)


def test_source_is_opened_again_and_what_ended_it_is_forgotten_when_it_is_back():
    done = threading.Event()

    class Last(Source):
        def __iter__(self):
            yield MadeCycle(1)
            done.wait(PATIENCE_S)

    sources = [Source(MadeCycle(1), error=ShareError("it has died")), Last()]

    def opening():
        if not sources:
            raise ShareError("there is none")
        return sources.pop(0)

    follower = Follower(opening, again_s=0.01)
    until(lambda: follower.n_opened == 2 and follower.n_cycles == 2)
    assert follower.error is None
    done.set()
    until(lambda: follower.error is not None)
    assert not follower.has_ended
    follower.close()
    assert follower.has_ended
