"""A start that waits for a bus: growing pauses, one line for a cause; without --wait it fails at once."""

import pytest

from skinbus.cli.attempts import LONGEST_PAUSE_S, Attempts
from skinbus.errors import BusError


class Manager:
    def __init__(self):
        self.heard = []

    def waiting(self, what, seconds):
        self.heard.append((what, seconds))


def attempt_after(n, errors):
    """An attempt that fails n times."""
    left = iter(range(n))

    def attempt():
        if next(left, None) is not None:
            raise BusError(errors)
        return "bus"

    return attempt


def test_a_missing_bus_is_waited_for_with_growing_pauses():
    said, slept, manager = [], [], Manager()
    attempts = Attempts(manager, said.append, waits=True, sleep=slept.append)
    assert attempts.until_done(attempt_after(50, "can0 is not there")) == "bus"
    assert said == ["waiting: can0 is not there"]
    pauses = [seconds for _, seconds in manager.heard]
    assert pauses == sorted(pauses)
    assert max(pauses) == LONGEST_PAUSE_S
    assert sum(slept) == pytest.approx(sum(pauses), abs=1.0)


def test_without_waiting_the_first_failure_is_the_answer():
    with pytest.raises(BusError, match="not there"):
        Attempts(Manager(), print, waits=False).until_done(attempt_after(1, "not there"))
