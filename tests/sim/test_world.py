"""The world on the in-process wire, with a small master that starts the patches and sends SYNC."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.frame import Frame, FrameBatch
from skinbus.can.virtual_bus import VirtualBus
from skinbus.config.system import ods_of
from skinbus.objects.readings import ReadingsPlan
from skinbus.sim import load_scene
from skinbus.sim.world import World

MS = 1_000_000
START_NS = 100 * MS


class Master(Core):
    """Starts all nodes at 100 ms, then sends SYNC every period, and keeps what it hears."""

    cob_ids = None

    def __init__(self, period_ns: int, *, delay_ns: int = 0) -> None:
        self.period_ns = period_ns
        self.next_ns = START_NS + delay_ns
        self.n_syncs = 0
        self.heard: list[Frame] = []

    def step(self, now_ns, frames=()):
        self.heard += frames
        out = []
        if now_ns >= self.next_ns:
            if not self.n_syncs:
                out.append(Frame(0x000, b"\x01\x00"))
            out.append(Frame(0x080))
            self.n_syncs += 1
            self.next_ns += self.period_ns
        return Step(out, (), self.next_ns)


def run(scene, *, seconds, delay_ns=0):
    """Return (world, master, wire, frames on the wire) after some seconds of scene time."""
    ods = ods_of(scene.arm)
    world = World(scene, ods)
    master = Master(round(1e9 / scene.arm.bus.rate_hz), delay_ns=delay_ns)
    wire = VirtualBus(scene.arm.bus.bitrate)
    frames = []
    wire.tap(frames.append)
    wire.attach(world)
    wire.attach(master)
    wire.run(START_NS + delay_ns + round(1e9 * seconds) - MS)
    return world, master, wire, frames


def readings_of(scene, frames):
    """Return the counts of every cycle and whether all of them arrived, (n_cycles, n_tactels)."""
    arm = scene.arm
    plan = ReadingsPlan(arm, ods_of(arm))
    batch = FrameBatch(1024)
    counts, seen = np.zeros(arm.n_tactels, np.int32), np.zeros(arm.n_patches, np.int32)
    cycles, complete = [], []
    for frame in [*frames, Frame(0x080)]:
        if frame.can_id == 0x080:
            plan.unpack(batch, counts, seen)
            cycles.append(counts.copy())
            complete.append((seen == plan.expected).all())
            batch.clear()
            seen[:] = 0
        elif frame.can_id in plan.cob_ids:
            batch.append(frame)
    return np.array(cycles[1:]), np.array(complete[1:])  # before the first SYNC there is nothing


@pytest.fixture(scope="module")
def forearm():
    scene = load_scene("forearm")
    return scene, *run(scene, seconds=5.0)


@pytest.mark.slow
def test_every_patch_boots_in_its_own_time_and_sends_every_cycle(forearm):
    scene, world, _, _, frames = forearm
    boots = [f for f in frames if 0x700 < f.can_id < 0x780 and f.data == b"\x00"]
    assert sorted(f.can_id - 0x700 for f in boots) == sorted(scene.arm.node_id.tolist())
    times = np.sort([f.t_ns for f in boots])
    assert times[0] > 4 * MS
    assert times[-1] - times[0] > 20 * MS
    counts, complete = readings_of(scene, frames)
    assert len(counts) == 250
    assert complete.all()
    assert world.n_samples == 250


def test_counts_on_the_bus_are_the_pressures_of_the_scene(forearm):
    scene, _, _, _, frames = forearm
    counts, _ = readings_of(scene, frames)
    step = scene.arm.patches[0].patch.transducer.step
    for k in (0, 60, 120, 180, 249):
        wanted = scene.pressures(k / scene.arm.bus.rate_hz)
        assert_allclose(counts[k] * step, wanted, atol=0.51 * step)
    assert counts.max() > 3000


def test_same_seed_gives_the_same_bytes_and_scene_time_follows_the_sync(forearm):
    scene, _, _, _, frames = forearm
    *_, late = run(scene, seconds=1.0, delay_ns=333 * MS)
    on_time = [f.data for f in frames if 0x180 < f.can_id < 0x500][: 24 * 4 * 50]
    delayed = [f.data for f in late if 0x180 < f.can_id < 0x500]
    assert on_time == delayed


def test_world_asks_to_be_woken_for_nothing_but_boot_and_heartbeat():
    world = World(load_scene("pad"))
    step = world.step(0)
    assert not step.frames
    assert 0 < step.wake_ns < 60 * MS
    boot = world.step(step.wake_ns)
    assert [f.can_id for f in boot.frames] == [0x701]
    beat = world.devices[0].get(0x1017) * MS
    assert boot.wake_ns == (step.wake_ns + beat if beat else NEVER)
