"""126 patches at 1 kHz of scene time: from scene to counts, and with boards and frames beside it.

python -m pytest tests/bench/test_sim_speed.py --benchmark-enable
A sample has 1000 us for real time.
"""

import math

import numpy as np
import pytest

from skinbus.config.system import ods_of
from skinbus.model import Arm, Link, PlacedPatch, Surface
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from skinbus.sim.effects import effect_class
from skinbus.sim.indenter import Shape
from skinbus.sim.laws import Elastic
from skinbus.sim.player import Player
from skinbus.sim.sampler import Sampler
from skinbus.sim.scene import Scene
from skinbus.sim.touch import Touch
from skinbus.sim.world import World

pytestmark = pytest.mark.slow

EFFECTS = ("gain_spread", "noise", "adc")
MAX_PATCHES = 126
SYNC_S = 1e-3
RING, PITCH = 9, 0.051


def long_arm(n):
    """A cylinder with rings of nine boards."""
    surface = Surface.cylinder(-(-n // RING) * PITCH, RING * PITCH / math.tau)
    board = describe_patch(load_eds("skin-patch", 1))
    places = [((p // RING + 0.5) * PITCH, float(surface.wrap(p % RING * PITCH))) for p in range(n)]
    patches = [
        PlacedPatch(patch=board, node_id=1 + p, link=0, s=s, a=a, eds="skin-patch")
        for p, (s, a) in enumerate(places)
    ]
    return Arm("long", [Link("arm", surface)], patches)


def busy_scene(arm, effects=(), *, n_touches=5):
    """Fingertips that press for good, spread over an arm."""
    touches = []
    for k in range(n_touches):
        placed = arm.patches[k * arm.n_patches // n_touches]
        path = np.array([[0.0, placed.s + 0.004, placed.a + 0.003]])
        force = np.array([[0.0, 5.0], [1e6, 5.0]])
        touches.append(Touch(link=placed.link, path=path, force=force, shape=Shape.DISC, length=0.012))
    return Scene("busy", arm, duration_s=1e6, layer=Elastic(), touches=touches, effects=effects)


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
