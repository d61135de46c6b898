"""The world on the in-process wire, with a small master that starts the patches and sends SYNC."""

import numpy as np
import pytest

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


def run(scene, *, seconds, delay_ns=0, follows="sync"):
    """Return (world, master, wire, frames on the wire) after some seconds of scene time."""
    ods = ods_of(scene.arm)
    world = World(scene, ods, follows=follows)
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
        np.testing.assert_allclose(counts[k] * step, wanted, atol=0.51 * step)
    assert counts.max() > 3000


def test_same_seed_gives_the_same_bytes_and_scene_time_follows_the_sync(forearm):
    scene, _, _, _, frames = forearm
    *_, late = run(scene, seconds=1.0, delay_ns=333 * MS)
    on_time = [f.data for f in frames if 0x180 < f.can_id < 0x500][: 24 * 4 * 50]
    delayed = [f.data for f in late if 0x180 < f.can_id < 0x500]
    assert on_time == delayed


def test_scene_time_may_follow_the_clock():
    """Then boards sample by themselves, and SYNC sends what was sampled last."""
    scene = load_scene("pad")
    world, _, _, frames = run(scene, seconds=1.0, delay_ns=505 * MS, follows="clock")
    assert world.scene_time(900 * MS) == pytest.approx(0.9)
    assert world.n_samples == 160, "at 100 Hz since power-on"
    counts, complete = readings_of(scene, frames)
    assert complete.all()
    step = scene.arm.patches[0].patch.transducer.step
    for k in (0, 7, 50):
        np.testing.assert_allclose(counts[k] * step, scene.pressures(0.6 + k / 100.0), atol=0.51 * step)


def test_quiet_patch_with_event_driven_tpdos_is_silent_until_it_is_touched():
    """No SYNC at all: TPDOs of type 255 come when a reading moved by more than its delta."""
    world = World(load_scene("pad"), follows="clock")
    device = world.devices[0]
    started = False
    now_ns, times = 0, []
    while now_ns < 900 * MS:
        start = now_ns > 60 * MS and not started
        if start:
            for number in range(4):
                device.set(0x1800 + number, 2, 255)
                device.set(0x1800 + number, 5, 0)
            for channel in range(1, 17):
                device.set(0x6421, channel, 0x04)
                device.set(0x6426, channel, 20)
            device.set(0x6423, 0, True)
            started = True
        step = world.step(now_ns, [Frame(0x000, b"\x01\x00")] if start else [])
        times += [now_ns for f in step.frames if 0x180 < f.can_id < 0x500]
        now_ns = max(step.wake_ns, now_ns + 1)
    touched = [t for t in times if t > 100 * MS]  # the first event of all tells where readings are
    assert touched
    assert min(touched) > 500 * MS, "the finger came at 0.5 s"
    assert max(touched) < 650 * MS, "and then held still"


def test_world_asks_to_be_woken_for_nothing_but_boot_and_heartbeat():
    world = World(load_scene("pad"))
    step = world.step(0)
    assert not step.frames
    assert 0 < step.wake_ns < 60 * MS
    boot = world.step(step.wake_ns)
    assert [f.can_id for f in boot.frames] == [0x701]
    beat = world.devices[0].get(0x1017) * MS
    assert boot.wake_ns == (step.wake_ns + beat if beat else NEVER)
