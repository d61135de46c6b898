"""The world of a scene: its patches boot, answer each SYNC with what the scene has, and rest in between."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skinbus.can.core import NEVER
from skinbus.can.frame import FrameBatch
from skinbus.config.system import ods_of
from skinbus.objects.readings import ReadingsPlan
from skinbus.sim import load_scene
from skinbus.sim.player import BOOT_NS, Player
from skinbus.sim.world import World
from tests.sim.truth import truth_of

MS = 1_000_000


def played(scene, n_cycles, *, delay_ns=0):
    """Return what is said in each of so many cycles, the first of which comes later by a delay."""
    player = Player(World(scene, ods_of(scene.arm)))
    player.run_to(BOOT_NS + delay_ns)
    return [player.cycle() for _ in range(n_cycles)]


@pytest.fixture(scope="module")
def forearm():
    scene = load_scene("forearm")
    return scene, played(scene, 250)


@pytest.mark.slow
def test_counts_on_the_bus_are_the_pressures_of_the_scene_in_every_cycle(forearm):
    scene, cycles = forearm
    plan, batch = ReadingsPlan(scene.arm, ods_of(scene.arm)), FrameBatch(1024)
    counts, step = np.zeros(scene.arm.n_tactels, np.int32), scene.arm.patches[0].patch.transducer.step
    highest, truth = 0, truth_of(scene)
    for k, frames in enumerate(cycles):
        seen = np.zeros(scene.arm.n_patches, np.int32)
        batch.n = 0
        batch.extend([frame for frame in frames if frame.can_id in plan.cob_ids_on[0]])
        plan.unpack(batch, counts, seen)
        assert (seen == plan.expected).all()
        wanted = truth(k / scene.arm.bus.rate_hz)
        assert_allclose(counts * step, wanted, atol=0.51 * step)
        highest = max(highest, counts.max())
    assert highest > 3000


def test_same_seed_gives_the_same_bytes_and_scene_time_follows_the_sync(forearm):
    scene, cycles = forearm
    late = played(scene, 50, delay_ns=333 * MS)
    for on_time, delayed in zip(cycles, late, strict=False):
        data = [[f.data for f in frames if 0x180 < f.can_id < 0x500] for frames in (on_time, delayed)]
        assert data[0] == data[1]


def test_world_wants_to_be_called_for_nothing_but_boot_and_heartbeat():
    world = World(load_scene("pad"))
    wake_ns = world.step(0).wake_ns
    assert 0 < wake_ns < 60 * MS
    boot = world.step(wake_ns)
    assert [f.can_id for f in boot.frames] == [0x701]
    beat = world.devices[0].get(0x1017) * MS
    assert boot.wake_ns == (wake_ns + beat if beat else NEVER)
