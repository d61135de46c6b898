"""Nothing but its work holds up a cycle: no kernel is compiled in it, no garbage collected."""

import gc
import subprocess
import sys
import threading
from itertools import count
from types import SimpleNamespace

import pytest

from skinbus.bus.interface import Bus
from skinbus.bus.loop import run_core
from skinbus.bus.realtime import N_WORTH_IT, GcScheduler
from skinbus.can.clock import VirtualClock
from skinbus.can.core import Core, Step
from skinbus.can.frame import FrameBatch

MS = 1_000_000

KERNELS_OF_A_MASTER = """
import gc
from numba.core.dispatcher import Dispatcher
from skinbus.can.virtual_bus import VirtualBus
from skinbus.master import Master
from skinbus.sim import World, load_scene

OTHERS = "skinbus.can.classic_bits", "skinbus.sim"  # the wire and the simulated patches

def ready():
    kernels = (o for o in gc.get_objects() if issubclass(type(o), Dispatcher))
    return {f"{o.py_func.__module__}.{o.__name__}{s}" for o in kernels for s in o.signatures}

scene = load_scene("pad")
world, wire = World(scene), VirtualBus(scene.arm.bus.bitrate)
master = Master(scene.arm, level="kmeans")
before = ready()
wire.attach(world)
wire.attach(master)
wire.run(1_500_000_000)
assert master.device.get(0x2100, 7) > 50 and master.device.get(0x3001, 1)
later = {name for name in ready() - before if name.startswith("skinbus.") and not name.startswith(OTHERS)}
assert not later, later
"""


@pytest.mark.slow
def test_all_kernels_are_ready_before_the_master_goes_on_the_bus():
    answer = subprocess.run(
        [sys.executable, "-c", KERNELS_OF_A_MASTER], capture_output=True, text=True, check=False
    )
    assert answer.returncode == 0, answer.stderr


class Litter(Core):
    """A core whose every step leaves cyclic garbage behind, in the middle of which time passes."""

    cob_ids = frozenset()

    def __init__(self):
        self.in_step = False
        self.n_steps = 0

    def step(self, now_ns, frames):
        self.in_step = True
        for _ in range(N_WORTH_IT // 2):
            ring = []
            ring.append(ring)
        self.in_step = False
        self.n_steps += 1
        return Step((), (), now_ns + 20 * MS)


class SilentBus(Bus):
    """Nothing comes, everything goes, time passes."""

    def __init__(self, clock):
        self.clock = clock
        self.batch = FrameBatch(1)

    def listen(self, cob_ids, data_ids=frozenset()):
        pass

    def receive(self, timeout_s):
        self.clock.move_to(self.clock.now_ns() + max(1000, round(timeout_s * 1e9)))
        return []

    def send(self, frames):
        return len(frames)

    def close(self):
        pass


class StopAfter(threading.Event):
    def __init__(self, core, n_steps):
        super().__init__()
        self.core, self.n_steps = core, n_steps

    def is_set(self):
        return self.core.n_steps >= self.n_steps


@pytest.mark.slow
def test_garbage_is_collected_between_the_steps_of_the_loop_never_in_one(monkeypatch):
    reads = count(0, MS // 10)  # a collection takes 0.1 ms, whatever else the machine does
    monkeypatch.setattr("skinbus.bus.realtime.time", SimpleNamespace(perf_counter_ns=lambda: next(reads)))
    core, clock = Litter(), VirtualClock()
    collections = []

    def watch(phase, info):
        if phase == "start":
            collections.append((core.in_step, sys._getframe(1).f_code.co_name))

    with GcScheduler() as tidy:
        gc.callbacks.append(watch)
        try:
            run_core(core, lambda: SilentBus(clock), stop=StopAfter(core, 500), clock=clock, tidy=tidy)
        finally:
            gc.callbacks.remove(watch)
    assert len(collections) > 150  # every third step
    assert set(collections) == {(False, "pause")}
