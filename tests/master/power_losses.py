"""Starts of a master's health and losses of power in the middle of a write: what is left is always whole.

``python -m tests.master.power_losses 10000`` does it so often; a number after that is the seed.

Power is lost at a call of the system, or in one: what was written and not flushed is cut anywhere, or zeros.
"""

import os
import random
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

from skinbus.cli.state_keeper import HealthKeeper, health_file
from tests.master.watched import Watched

STEPS = ("fsync", "replace", "replace", "fsync", "none")
"""Of one save, in their order."""


class PowerLossError(Exception):
    """The power went away."""


class Power:
    """Lets the power go at the k-th call of one save."""

    def __init__(self, rng):
        self.rng = rng
        self.left = None
        self._fsync, self._replace = os.fsync, os.replace

    def __enter__(self):
        os.fsync, os.replace = self.fsync, self.replace
        return self

    def __exit__(self, *error):
        os.fsync, os.replace = self._fsync, self._replace

    def call(self):
        if self.left is not None:
            self.left -= 1
            if self.left < 0:
                raise PowerLossError

    def fsync(self, number):
        if self.left == 0 and os.path.isfile(f"/proc/self/fd/{number}"):  # half of it is on the disk
            size = os.fstat(number).st_size
            keep = self.rng.randrange(size + 1)
            os.ftruncate(number, keep)
            if self.rng.random() < 0.5:
                os.ftruncate(number, size)  # the rest are zeros
        self.call()

    def replace(self, old, new):
        self.call()
        self._replace(old, new)


def lose_power(n, seed, folder):
    """Start and lose power ``n`` times; return how many saves were whole."""
    rng, state, n_saved = random.Random(seed), Path(folder) / "state", 0
    has_file = False
    watched = Watched(seed)
    watched.run(3)
    last, said = 0, []
    with Power(rng) as power:
        for k in range(n):
            tables = health_file(state).load()
            assert not has_file or tables is not None, f"seed {seed}, loss {k}: broken"
            has_file = tables is not None
            touches = watched.health.records["touches"]
            touches[:] = 0.0
            keeper = HealthKeeper(state, watched.health, said.append)
            keeper.resume()
            here = int(touches[0])
            assert (touches == here).all(), f"seed {seed}, loss {k}: torn"
            assert here in (last, last + 1), f"seed {seed}, loss {k}: {here} after {last}"
            last = here
            touches[:] = here + 1
            power.left = rng.randrange(len(STEPS))
            with suppress(PowerLossError):
                keeper.write(at_end=True)
                n_saved += 1
                last += 1
            power.left = None
            for unfinished in Path(folder).glob(".*.tmp"):  # of another process by then
                unfinished.rename(unfinished.with_name(f"old-{k % 3}.tmp"))
    return n_saved


if __name__ == "__main__":
    n_losses = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    first_seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    with tempfile.TemporaryDirectory() as where:
        whole = lose_power(n_losses, first_seed, where)
        print(f"{n_losses} starts and losses of power, {whole} saves ended, never a broken file")
