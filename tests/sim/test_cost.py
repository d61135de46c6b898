"""The price list of a scene: its parts add up to the whole."""

from skinbus.sim import load_scene
from skinbus.sim.cost import measure


def test_parts_are_what_a_clock_says_of_them():
    """With a clock that counts its own readings, every variant costs the same and every part nothing."""
    reading = iter(range(10**9))
    cost = measure(load_scene("press"), lambda: 1000 * next(reading), n_cycles=5)
    assert cost.whole_us == 1.0
    assert cost.parts == {"boards and frames": 1.0, "touches": 0.0}
