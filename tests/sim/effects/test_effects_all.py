"""The laws that hold for every effect: identity at zero, seeds, independence, lazy import, any pair."""

import tomllib

import numpy as np
import pytest

from skinbus.sim.effect import ORDER, Stage
from skinbus.sim.effects import effect_class
from tests.run_in_process import run_code

ZERO = tomllib.loads("""
sync_jitter = { sigma_us = 0.0 }
misplaced = { sigma_mm = 0.0, sigma_deg = 0.0 }
bend = { kpa_per_mm = 0.0 }
viscoelastic = { relaxation = 0.0 }
hysteresis = { loop = 0.0 }
gain_spread = { sigma = 0.0 }
piezoresistive = { load_ratio = 0.0, linearity = 0.0 }
response = { gain = 0.0, width = 0.0, ellipse = 1.0, offset_pa = 0.0, residual = 0.0 }
shear = { friction = 0.0 }
thermal = { start_c = 0.0, end_c = 0.0, board_sigma_c = 0.0 }
burst = { per_minute = 0.0 }
drift = { per_decade = 0.0 }
dead = { share = 0.0 }
crosstalk = { row = 0.0, column = 0.0 }
offset = { sigma_pa = 0.0 }
noise = { sigma_pa = 0.0 }
saturation = { limit_kpa = 1e6 }
adc = { bits = 16 }
stuck = { share = 0.0 }
clock_drift = { sigma_ppm = 0.0 }
patch_reset = { per_hour = 0.0 }
patch_silent = { nodes = [] }
bus_off = { nodes = [] }
response_jitter = { sigma_us = 0.0 }
babbling_node = { rate_hz = 0.0 }
corrupt = { probability = 0.0 }
delay = { constant_us = 0.0, mean_us = 0.0 }
loss = { probability = 0.0 }
""")
"""Zero strength."""

STRONG = tomllib.loads("""
sync_jitter = { sigma_us = 2000.0 }
drift = { first_s = 0.01 }
dead = { share = 0.3 }
stuck = { share = 0.3 }
saturation = { limit_kpa = 5.0 }
thermal = { tau_s = 0.1 }
burst = { per_minute = 1000.0 }
clock_drift = { sigma_ppm = 50000.0 }
patch_reset = { resets = [[1, 0.1]] }
patch_silent = { nodes = [1], from_s = 0.06, to_s = 0.1 }
bus_off = { nodes = [1], at_s = 0.06, recovery_s = 0.05 }
corrupt = { probability = 0.3 }
loss = { probability = 0.3 }
""")
"""Parameters that show within a fifth of a second, where the defaults would not."""

N = 20


def zero(name):
    return effect_class(name)(**ZERO[name])


def strong(name):
    return effect_class(name)(**STRONG.get(name, {}))


@pytest.fixture(scope="module")
def plain(simulate, pad):
    return simulate(n_syncs=N)


@pytest.fixture(scope="module")
def alone(simulate, pad):
    return {name: simulate([strong(name)], n_syncs=N) for name in ORDER}


def test_order_names_every_effect_in_the_order_of_the_stages():
    classes = [effect_class(name) for name in ORDER]
    assert [cls.name for cls in classes] == list(ORDER)
    assert set(ORDER) == set(ZERO)
    stages = [cls.stage for cls in classes]
    assert stages == sorted(stages)


@pytest.mark.parametrize("name", ORDER)
def test_zero_strength_is_the_identity_bit_for_bit(simulate, plain, name):
    assert simulate([zero(name)], n_syncs=N).frames == plain.frames


@pytest.mark.parametrize("name", ORDER)
def test_strength_shows_and_same_seed_gives_same_bytes(simulate, plain, alone, name):
    if name == "clock_drift":  # there is no heartbeat within a fifth of a second: see its own test
        assert alone[name].world.sampler.clock_ppm.any()
    elif name != "bend":  # a pad is flat
        assert alone[name].frames != plain.frames
    assert simulate([strong(name)], n_syncs=N).frames == alone[name].frames


@pytest.mark.parametrize("name", ORDER)
def test_adding_an_effect_leaves_all_other_draws_bit_identical(simulate, pad, monkeypatch, name):
    """Streams are compared as they stand after binding and after a run."""

    def states(chosen):
        streams = {}

        def keep(seed, stream_name, bus=0):
            rng = np.random.Generator(np.random.PCG64DXSM([seed, len(stream_name), *stream_name.encode()]))
            streams[stream_name] = rng
            return rng

        monkeypatch.setattr("skinbus.sim.sampler.stream", keep)
        monkeypatch.setattr("skinbus.sim.world.stream", keep)
        simulate([strong(one) for one in chosen], n_syncs=4)
        return {key: rng.bit_generator.state for key, rng in streams.items()}

    others = [one for one in ORDER if one != name and effect_class(one).stage is not Stage.FRAMES]
    without, within = states(others), states([*others, name])
    assert set(within) - set(without) == {name}
    for one in others:
        assert within[one] == without[one], one


@pytest.mark.slow
def test_module_of_effects_that_no_scene_names_is_not_imported():
    """A fresh interpreter runs a world without effects, then one with two."""
    code = """
import sys
from dataclasses import FrozenInstanceError
from skinbus.sim import World, load_scene
from skinbus.sim.scene_file import scene_of
from skinbus.can.frame import Frame

def loaded():
    return sorted(m.rsplit(".", 1)[1] for m in sys.modules if m.startswith("skinbus.sim.effects."))

def run(scene):
    world = World(scene)
    world.step(0)
    world.step(100_000_000, [Frame(0, b"\\x01\\x00"), Frame(0x80, b"\\x01")])

run(load_scene("pad"))
assert loaded() == [], loaded()
head = {"arm": "pad", "duration_s": 1.0}
run(scene_of({"scene": head, "effect": {"noise": {}, "adc": {"bits": 10}}}))
assert loaded() == ["readings"], loaded()
"""
    run_code(code)


def test_order_of_naming_says_nothing_and_all_together_send_can_frames(simulate):
    """Finite readings and frames that are CAN frames."""
    runs = [simulate([strong(name) for name in names], n_syncs=8) for names in (ORDER, ORDER[::-1])]
    assert runs[0].frames == runs[1].frames
    assert len(runs[0].counts) == 8
    for frame in runs[0].frames:
        assert 0 <= frame.can_id <= 0x7FF
        assert len(frame.data) <= 8
    assert all(abs(int(counts.min())) <= 0x8000 and counts.max() <= 0x7FFF for counts in runs[0].counts)
