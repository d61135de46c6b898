"""Processes around shared memory: one that writes cycles without end, and what a cycle of it must hold.

python -m tests.skin.shared_processes write NAME [PAUSE_S]   until it is killed; half cycles, too
"""

import sys
import time

import numpy as np

from skinbus.config.system import load_arm
from skinbus.skin.contact import CONTACT
from skinbus.skin.cycle import PATCH, Readings, SkinLayout
from skinbus.skin.shared_memory import SharedWriter, path_of
from tests.skin.scripted import made_cycle

LAYOUT = SkinLayout.of(load_arm("forearm"))


def uniform(number, t_ns=None, **changes):
    """A cycle in which everything is its number, so that a mixture of two is found."""
    n = LAYOUT.n_tactels
    records = np.zeros(number % 65, CONTACT)
    for name in ("identity", "seen_ns", "force", "s", "covariance"):
        records[name] = number
    patches = np.zeros(len(LAYOUT.node_id), PATCH)
    patches["last_fresh_ns"] = number
    readings = Readings(np.full(n, float(number % 4096)), np.ones(n, bool), np.zeros(n, np.uint8))
    same = {"records": records, "patch_records": patches, "readings": readings, "latency_s": 1e-9 * number}
    return made_cycle(number, t_ns or time.monotonic_ns(), LAYOUT, **same | changes)


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
    cycles = [uniform(n) for n in range(1, 2000)]
    writer = SharedWriter(name, LAYOUT)
    print("ready", flush=True)
    for cycle in cycles:
        writer.write(cycle)
        time.sleep(pause_s)
    number = len(cycles)
    while True:
        number += 1
        writer.write(uniform(number))
        time.sleep(pause_s)


CRAFTED = [(at, value) for at in (32, 36, 40, 44, 48, 52, 56, 60) for value in (0, 1 << 31, (1 << 32) - 1)]
CRAFTED += [(16, (1 << 64) - 1), (16, 5)]
"""Places in a header, and values: n_slots, slot_bytes, first_slot, contacts_offset, counts; and newest."""


def crafted_memory(name, at, value):
    """Make memory of a writer that has ended with another value at a place of its header; return the name."""
    writer = SharedWriter(name, LAYOUT)
    memory = bytearray(path_of(name).read_bytes())
    writer.close()
    n = 8 if at == 16 else 4
    memory[at : at + n] = value.to_bytes(n, "little")
    path_of(name).write_bytes(memory)
    return name


if __name__ == "__main__":
    action, name, *pause_s = sys.argv[1:]
    write(name, *map(float, pause_s))
