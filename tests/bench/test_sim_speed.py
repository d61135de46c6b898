"""126 patches at 1 kHz of scene time: from scene to counts, and with boards and frames beside it.

python -m pytest tests/bench/test_sim_speed.py --benchmark-enable
A sample has 1000 us for real time.
"""

import time

import pytest

from skinbus.config.system import ods_of
from skinbus.sim import load_scene
from skinbus.sim.cost import measure
from skinbus.sim.effects import effect_class
from skinbus.sim.player import Player
from skinbus.sim.sampler import Sampler
from skinbus.sim.scaling import MAX_PATCHES, SYNC_S, busy_scene, long_arm
from skinbus.sim.world import World

pytestmark = pytest.mark.slow

EFFECTS = ("gain_spread", "noise", "adc")


@pytest.fixture(scope="module")
def arm():
    return long_arm(MAX_PATCHES)


def samples(sampler):
    clock = [0]

    def sample():
        clock[0] += 1
        sampler.sample(SYNC_S * clock[0])

    return sample


def test_scene_to_counts(benchmark, arm):
    benchmark(samples(Sampler(busy_scene(arm, [effect_class(name)() for name in EFFECTS]))))


def test_quiet_scene_to_counts(benchmark, arm):
    benchmark(samples(Sampler(busy_scene(arm, n_touches=0))))


def test_scene_to_frames(benchmark, arm):
    scene = busy_scene(arm, [effect_class(name)() for name in EFFECTS])
    player = Player(World(scene, ods_of(arm)))
    frames = benchmark(player.cycle)
    assert len(frames) >= 4 * MAX_PATCHES


def test_parts_of_everything_beside_the_whole(benchmark):
    """Prints how the parts of the price list add up: 1 is all of it; within a fifth is what is wanted."""
    scene, n_cycles = ("press", 4) if benchmark.disabled else ("everything", 100)
    cost = benchmark.pedantic(
        lambda: measure(load_scene(scene), time.thread_time_ns, n_cycles=n_cycles), rounds=1
    )
    print(f"sum of the parts over the whole: {cost.sum_us / cost.whole_us:.3f}")
    assert cost.whole_us > 0.0
