"""Runs of single effects on an arm, and of whole worlds, without a bus."""

import numpy as np
import pytest

from skinbus.can.frame import Frame
from skinbus.config.system import ods_of
from skinbus.sim.effect import stream
from skinbus.sim.laws import Elastic
from skinbus.sim.layer import Geometry
from skinbus.sim.player import BOOT_NS, Player
from skinbus.sim.scene import Scene
from skinbus.sim.touch import Touch
from skinbus.sim.world import World


@pytest.fixture(scope="session")
def apply(forearm):
    """``apply(effect, pressures, times)``: what an effect makes of (n,) or (n_times, n) inputs over time."""

    def run(effect, pressures, times, *, arm=forearm, seed=7, dtype=np.float64):
        step = effect.bind(arm, stream(seed, effect.name))
        times = np.asarray(times, float)
        given = np.broadcast_to(np.asarray(pressures, dtype), (len(times), arm.n_tactels))
        return np.array([step(row.copy(), float(t_s)) for row, t_s in zip(given, times, strict=True)])

    return run


@pytest.fixture(scope="session")
def mount(forearm):
    """``mount(effect)``: the geometry after an effect of the mounting."""

    def run(effect, *, arm=forearm, seed=7):
        geometry = Geometry.of(arm, discs=True)
        effect.bind(arm, stream(seed, effect.name))(geometry)
        return geometry

    return run


class Run:
    """What a world said: frames with the time of the step that said them, and the counts of each sample."""

    def __init__(self):
        self.frames = []
        self.counts = []
        self.world = None

    def tpdos(self, node_id=None):
        return [f for f in self.frames if 0x180 < f.can_id < 0x500 and node_id in (None, f.can_id & 0x7F)]

    def boots(self):
        return [f for f in self.frames if f.can_id > 0x700 and f.data == b"\x00"]


@pytest.fixture(scope="session")
def ods_by_arm():
    cache = {}

    def get(arm):
        if arm.name not in cache:
            cache[arm.name] = ods_of(arm)
        return cache[arm.name]

    return get


@pytest.fixture(scope="session")
def simulate(pad, ods_by_arm):
    """``simulate(effects, n_syncs)``: a world of a pressed arm, booted, started, and sent SYNCs."""

    def run(effects=(), n_syncs=30, *, arm=pad):
        touch = Touch(
            link=0,
            path=np.array([[0.0, 0.028, 0.003]]),
            force=np.array([[0.0, 0.0], [0.05, 6.0], [1e3, 6.0]]),
            inclination=0.3,  # acts where shear is named
            direction=0.7,
        )
        scene = Scene("test", arm, duration_s=1e3, seed=1, layer=Elastic(), touches=[touch], effects=effects)
        result = Run()
        result.world = world = World(scene, ods_by_arm(arm))
        inner = world.step

        def step(now_ns, frames=()):
            said = inner(now_ns, frames)
            result.frames += [f._replace(t_ns=now_ns) for f in said.frames]
            return said

        world.step = step
        player = Player(world)
        world.step(BOOT_NS, [Frame(0x000, b"\x01\x00")])  # a boot-up message may be lost
        for _ in range(n_syncs):
            player.cycle()
            result.counts.append(world.sampler.counts.copy())
        return result

    return run
