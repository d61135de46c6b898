"""How long tests wait for commands, and how often they let two processes meet in real time."""

import time

PATIENCE_S = 300.0
"""For the end of a command: nothing waits that long when all is well, but the first start may compile."""

TRIES = 5
"""A machine that holds a process up for longer than a time-out makes the other one give it up: once more."""


def wait_until(so, every_s=0.01):
    """Wait until something is so; return what it is."""
    end = time.monotonic() + PATIENCE_S
    while not (answer := so()):
        assert time.monotonic() < end
        time.sleep(every_s)
    return answer


def until_in_time(attempt, was_in_time):
    """Return what an attempt gave once it was in time, or what the last of TRIES gave."""
    for _ in range(TRIES):
        result = attempt()
        if was_in_time(result):
            break
    return result
