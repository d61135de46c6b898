"""clock_drift: rates that scatter, and heartbeats that show them."""

import numpy as np

from skinbus.objects.cia import HEARTBEAT_PRODUCER
from skinbus.sim import load_scene
from skinbus.sim.effect import stream
from skinbus.sim.effects.clock_drift import ClockDrift
from skinbus.sim.scene import Scene
from skinbus.sim.world import World


def test_rates_scatter_as_their_parameter_says(forearm):
    rates = []
    for seed in range(40):
        step = ClockDrift(sigma_ppm=30.0).bind(forearm, stream(seed, "clock_drift"))
        rates.append(step(np.zeros(forearm.n_patches)))
    rates = np.concatenate(rates)
    assert abs(rates.mean()) < 4 * 30 / np.sqrt(len(rates))
    assert abs(rates.std() / 30 - 1.0) < 4 / np.sqrt(2 * len(rates))


def test_heartbeats_of_a_fast_clock_come_early():
    base = load_scene("pad")
    scene = Scene(
        "test", base.arm, duration_s=1.0, layer=base.layer, effects=[ClockDrift(sigma_ppm=50_000.0)]
    )
    world = World(scene)
    ppm = float(world.sampler.clock_ppm[0])
    assert abs(ppm) > 1000
    beats = []
    wake_ns = world.step(0).wake_ns
    while len(beats) < 6:
        now_ns = wake_ns
        step = world.step(now_ns)
        beats += [now_ns for f in step.frames if f.can_id == 0x701]
        wake_ns = step.wake_ns
        if step.frames:
            world.devices[0].set(HEARTBEAT_PRODUCER, 0, 100)
    period = np.diff(beats[2:]).mean()
    assert abs(period / (100e6 / (1.0 + 1e-6 * ppm)) - 1.0) < 1e-5
