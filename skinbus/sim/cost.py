"""What a scene costs per cycle, and which of its parts costs how much: measured by leaving the part out.

Every variant of the scene (whole, without one effect, without touches, with neither) plays the same cycles,
several times, in turns of a few cycles, so that what else the machine does falls on all alike. What counts
is the fastest cycle of each turn, for disturbance only adds, and the trimmed mean over the turns.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.stats import trim_mean

from skinbus.config.system import ods_of
from skinbus.sim.effect import Effect
from skinbus.sim.player import Player
from skinbus.sim.scene import Scene
from skinbus.sim.world import World

Floats = npt.NDArray[np.float64]

_TURN: Final = 4
"""Cycles of one variant before it is the next one's turn: enough to warm the processor's caches."""
_SPACING: Final = 2
"""Variants between two runs of the whole."""
_TRIM: Final = 0.1
"""Share of the turns that is left out at either end: what the machine did meanwhile."""
_WHOLE: Final = "whole"
_BARE: Final = "boards and frames"


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One row: an effect, the touches, or the boards and their frames."""

    name: str
    us: float
    """Time per cycle, us; an effect that takes frames away can be below zero."""
    percent: float
    """Of the whole."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """The cost of a cycle and of its parts."""

    whole_us: float
    parts: tuple[Part, ...]

    @property
    def sum_us(self) -> float:
        """Sum of the parts, us; the whole, were the parts without influence on each other."""
        return sum(part.us for part in self.parts)


def measure(
    scene: Scene,
    stopwatch: Callable[[], int],
    *,
    n_cycles: int | None = None,
    rounds: int = 1,
    progress: Callable[[float], object] = lambda share: None,
) -> Cost:
    """Return what a scene costs per SYNC cycle.

    Args:
        scene: all of it is played.
        stopwatch: a clock in ns; ``time.thread_time_ns`` leaves out what other processes take.
        n_cycles: cycles of a run, from the start of the scene; the whole scene if not given.
        rounds: times that all of it is done anew.
        progress: called with the share that is done, 0 to 1, now and then.
    """
    if n_cycles is None:
        n_cycles = max(1, round(scene.duration_s * scene.arm.bus.rate_hz))
    variants = {_BARE: variant(scene, (), touches=False)}
    if scene.touches:
        variants["touches"] = variant(scene, scene.effects, touches=False)
    for effect in scene.effects:
        others = [other for other in scene.effects if other is not effect]
        variants[effect.name] = variant(scene, others)
    ods = ods_of(scene.arm)
    runs = list(variants.items())
    for place in range(len(runs), -1, -_SPACING):
        runs.insert(place, (_WHOLE, scene))
    times = np.empty((rounds, len(runs), n_cycles))
    for done, round_times in enumerate(times):
        players = [Player(World(played, ods)) for _, played in runs]
        with _no_collection():
            for first in range(0, n_cycles, _TURN):
                turn = range(first, min(first + _TURN, n_cycles))
                progress((done + first / n_cycles) / rounds)
                for player, row in zip(players, round_times, strict=True):
                    _play(player, turn, row, stopwatch)
    # worlds made early run slower than those made late: each variant is held against the whole beside it
    starts = np.arange(0, n_cycles, _TURN)
    fastest = [np.minimum.reduceat(round_times, starts, axis=1) for round_times in times]
    us: Floats = np.asarray(trim_mean(np.concatenate(fastest, axis=1), _TRIM, axis=1)) / 1e3
    places = np.array([k for k, (name, _) in enumerate(runs) if name == _WHOLE])
    beside = np.interp(np.arange(len(runs)), places, us[places])
    whole = float(us[places].mean())
    costs = {name: float(beside[k] - us[k]) for k, (name, _) in enumerate(runs) if name != _WHOLE}
    costs[_BARE] = whole - costs[_BARE]
    parts = (Part(name=name, us=cost, percent=100.0 * cost / whole) for name, cost in costs.items())
    return Cost(whole_us=whole, parts=tuple(parts))


def variant(scene: Scene, effects: Sequence[Effect], *, touches: bool = True) -> Scene:
    """Return the same scene with other effects, with or without its touches."""
    return Scene(
        scene.name,
        scene.arm,
        duration_s=scene.duration_s,
        seed=scene.seed,
        layer=scene.layer,
        touches=scene.touches if touches else (),
        effects=effects,
        motion=scene.motion,
    )


def _play(player: Player, cycles: range, times: Floats, stopwatch: Callable[[], int]) -> None:
    """Write down the time of each cycle (ns)."""
    for k in cycles:
        begin = stopwatch()
        player.cycle()
        times[k] = stopwatch() - begin


@contextmanager
def _no_collection() -> Iterator[None]:
    """Keep Python's garbage collector from falling on one variant."""
    enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
