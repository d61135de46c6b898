"""What a scene costs per cycle, and which of its parts costs how much: measured by leaving the part out.

Every variant of the scene (whole, without one effect, without touches, with neither) plays the same cycles in
turns, so that what else the machine does falls on all alike; the median of a variant's cycles counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from skinbus.config.system import ods_of
from skinbus.sim.player import Player
from skinbus.sim.scene import Scene
from skinbus.sim.world import World


class Cost(NamedTuple):
    """The cost of a cycle, and of its parts, us; an effect that takes frames away can be below zero."""

    whole_us: float
    parts: dict[str, float]


def measure(scene: Scene, stopwatch: Callable[[], int], *, n_cycles: int | None = None) -> Cost:
    """Return what a scene costs per SYNC cycle.

    Args:
        scene: all of it is played.
        stopwatch: a clock in ns; ``time.thread_time_ns`` leaves out what other processes take.
        n_cycles: cycles from the start of the scene; the whole scene if not given.
    """
    n_cycles = n_cycles or max(1, round(scene.duration_s * scene.arm.bus.rate_hz))
    scenes = {"boards and frames": replace(scene, effects=(), touches=())}
    if scene.touches:
        scenes["touches"] = replace(scene, touches=())
    for effect in scene.effects:
        scenes[effect.name] = replace(
            scene, effects=[other for other in scene.effects if other is not effect]
        )
    ods = ods_of(scene.arm)
    players = [Player(World(variant, ods)) for variant in (scene, *scenes.values())]
    times = np.empty((len(players), n_cycles))
    for cycle in range(n_cycles):
        for player, row in zip(players, times, strict=True):
            begin = stopwatch()
            player.cycle()
            row[cycle] = stopwatch() - begin
    whole, *others = (1e-3 * np.median(times, axis=1)).tolist()
    parts = {name: whole - us for name, us in zip(scenes, others, strict=True)}
    parts["boards and frames"] = others[0]
    return Cost(whole_us=whole, parts=parts)
