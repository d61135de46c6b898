"""Processes around shared memory: one that writes cycles without end, and what a cycle of it must hold.

python -m tests.skin.shared_processes write NAME [PAUSE_S]   until it is killed; half cycles, too
python -m tests.skin.shared_processes read NAME N            N snapshots; prints how many were torn
"""

import sys
import time

import numpy as np

from skinbus.config.system import load_arm
from skinbus.estimate import DEFAULT_LEVEL
from skinbus.master.level_control import CycleFlags
from skinbus.skin.cycle import CONTACT, PATCH, Cycle, Now, Readings, SkinLayout
from skinbus.skin.shared_memory import SharedReader, SharedWriter

ARM = load_arm("forearm")
LAYOUT = SkinLayout.of(ARM)


class Uniform(Cycle):
    """A cycle in which everything is its number, so that a mixture of two is found."""

    def __init__(self, number):
        now_ns = time.monotonic_ns()
        super().__init__(
            number,
            now_ns,
            number % 240 + 1,
            DEFAULT_LEVEL,
            CycleFlags(0),
            1e-9 * number,
            LAYOUT,
            Now(None, 0),
        )
        n = LAYOUT.n_tactels
        self.made = np.zeros(number % 65, CONTACT)
        self.made["identity"] = self.made["seen_ns"] = number
        self.made["force"] = self.made["s"] = number
        self.made["covariance"] = number
        self.states = np.zeros(len(LAYOUT.node_id), PATCH)
        self.states["last_fresh_ns"] = number
        self.readings = Readings(np.full(n, float(number % 4096)), np.ones(n, bool), np.zeros(n, np.uint8))

    @property
    def records(self):
        return self.made

    @property
    def patch_records(self):
        return self.states


def is_whole(cycle):
    """Whether all of a cycle out of shared memory is of its number."""
    n = cycle.number
    records = cycle.records
    return (
        len(records) == n % 65
        and cycle.counter == n % 240 + 1
        and round(1e9 * cycle.latency_s) == n
        and all((records[key] == n).all() for key in ("identity", "seen_ns", "force", "s", "covariance"))
        and (cycle.patch_records["last_fresh_ns"] == n).all()
        and (cycle.readings.pressures == n % 4096).all()
        and cycle.readings.valid.all()
    )


def write(name, pause_s=0.0):
    cycles = [Uniform(n) for n in range(1, 2000)]
    writer = SharedWriter(name, LAYOUT)
    print("ready", flush=True)
    for cycle in cycles:
        writer.write(cycle)
        time.sleep(pause_s)
    number = len(cycles)
    while True:
        number += 1
        writer.write(Uniform(number))
        time.sleep(pause_s)


def read(name, n):
    """Read snapshots as fast as possible; return how many were read, torn, tried in vain, and distinct."""
    reader = SharedReader(name)
    n_torn = n_missed = n_distinct = last = 0
    offsets = reader.offsets
    for _ in range(n):
        number = reader.newest
        data = reader.read(number)
        if data is None:
            n_missed += 1
            continue
        if number != last:
            last, n_distinct = number, n_distinct + 1
        words = np.frombuffer(data, "<i8", len(data) // 8)
        whole = words[1] == number and words[3] == number
        whole &= bool((words[6 : 6 + 2 * 24 : 2] == number).all())
        records = words[offsets.contacts // 8 :].reshape(-1, CONTACT.itemsize // 8)
        whole &= len(records) == number % 65 and bool((records[:, 0] == number).all())
        n_torn += not whole
    return n - n_missed, n_torn, n_missed, n_distinct


if __name__ == "__main__":
    action, name, *rest = sys.argv[1:]
    if action == "write":
        write(name, float(rest[0]) if rest else 0.0)
    else:
        began = time.monotonic()
        n_read, n_torn, n_missed, n_distinct = read(name, int(float(rest[0])))
        seconds = time.monotonic() - began
        print(
            f"{n_read} snapshots of {n_distinct} cycles in {seconds:.0f} s: {n_torn} torn, {n_missed} retried"
        )
