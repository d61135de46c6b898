"""The price list of a scene: its parts add up to the whole."""

import time

import pytest

from skinbus.sim import load_scene
from skinbus.sim.cost import measure
from skinbus.sim.effects import ORDER


@pytest.mark.slow
def test_every_effect_of_everything_has_a_price():
    cost = measure(load_scene("everything"), time.thread_time_ns, n_cycles=20)
    assert list(cost.parts)[:2] == ["boards and frames", "touches"]
    assert len(cost.parts) == 2 + len(ORDER)


def test_parts_are_what_a_clock_says_of_them():
    """With a clock that counts its own readings, every variant costs the same and every part nothing."""
    reading = iter(range(10**9))
    cost = measure(load_scene("press"), lambda: 1000 * next(reading), n_cycles=5)
    assert cost.whole_us == 1.0
    assert cost.parts == {"boards and frames": 1.0, "touches": 0.0}
