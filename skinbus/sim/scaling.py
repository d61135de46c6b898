"""How the cost of a scene grows: with the number of patches, and with the number of effects."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from skinbus.config.system import ods_of
from skinbus.model import Arm, Link, PlacedPatch, Surface
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from skinbus.sim.effect import Effect
from skinbus.sim.effects import ORDER, effect_class
from skinbus.sim.indenter import Shape
from skinbus.sim.laws import Elastic
from skinbus.sim.player import Player
from skinbus.sim.sampler import Sampler
from skinbus.sim.scene import Scene
from skinbus.sim.touch import Touch
from skinbus.sim.world import World

MAX_PATCHES: Final = 126
"""Node-IDs that are left when the master has one."""
SYNC_S: Final = 1e-3
"""Scene time between samples: 1 kHz."""

_RING: Final = 9
_PITCH: Final = 0.051
_TOUCHES: Final = 5
_EDS: Final = "skin-patch"


class ByPatches(NamedTuple):
    """One row: median cost of a cycle with so many patches, us."""

    n_patches: int
    quiet: float
    """Nothing presses, no effects: from scene to counts."""
    touched: float
    """Five touches."""
    noisy: float
    """Five touches, gain spread, noise and converter."""
    world: float
    """The same with its boards and their frames."""


class ByEffects(NamedTuple):
    """One row: median cost of a cycle with so many effects on, us."""

    n_effects: int
    added: str
    """The effect that this row has and the row before has not."""
    us: float


def long_arm(n_patches: int) -> Arm:
    """Return a cylinder with rings of nine boards, the last ring as full as need be."""
    rings = -(-n_patches // _RING)
    surface = Surface.cylinder(rings * _PITCH, _RING * _PITCH / math.tau)
    board = describe_patch(load_eds(_EDS, 1), _EDS)
    patches = [
        PlacedPatch(
            patch=board,
            node_id=1 + p,
            link=0,
            s=(p // _RING + 0.5) * _PITCH,
            a=float(surface.wrap(p % _RING * _PITCH)),
            eds=_EDS,
        )
        for p in range(n_patches)
    ]
    return Arm(f"{n_patches} patches", [Link("arm", surface)], patches)


def busy_scene(arm: Arm, effects: Sequence[Effect] = (), *, n_touches: int = _TOUCHES) -> Scene:
    """Return a scene of fingertips that press for good, spread over an arm."""
    touches = []
    for k in range(n_touches):
        placed = arm.patches[k * arm.n_patches // n_touches]
        path = np.array([[0.0, placed.s + 0.004, placed.a + 0.003]])
        force = np.array([[0.0, 5.0], [1e6, 5.0]])
        touches.append(Touch(link=placed.link, path=path, force=force, shape=Shape.DISC, length=0.012))
    return Scene("busy", arm, duration_s=1e6, layer=Elastic(), touches=touches, effects=effects)


def by_patches(
    stopwatch: Callable[[], int], counts: Sequence[int], *, n_cycles: int = 300
) -> list[ByPatches]:
    """Return the cost of arms of so many patches."""
    effects = [effect_class(name)() for name in ("gain_spread", "noise", "adc")]
    rows = []
    for n in counts:
        arm = long_arm(n)
        samplers = [
            Sampler(busy_scene(arm, n_touches=0)),
            Sampler(busy_scene(arm)),
            Sampler(busy_scene(arm, effects)),
        ]
        quiet, touched, noisy = (_sampling_us(sampler, stopwatch, n_cycles) for sampler in samplers)
        world = _playing_us(World(busy_scene(arm, effects), ods_of(arm)), stopwatch, n_cycles)
        rows.append(ByPatches(n, quiet, touched, noisy, world))
    return rows


def by_effects(stopwatch: Callable[[], int], arm: Arm, *, n_cycles: int = 300) -> list[ByEffects]:
    """Return the cost of a cycle with no effect, the first, the first two ... in the order of physics."""
    ods = ods_of(arm)
    rows = []
    for n in range(len(ORDER) + 1):
        effects = [effect_class(name)() for name in ORDER[:n]]
        us = _playing_us(World(busy_scene(arm, effects), ods), stopwatch, n_cycles)
        rows.append(ByEffects(n, ORDER[n - 1] if n else "", us))
    return rows


def _sampling_us(sampler: Sampler, stopwatch: Callable[[], int], n_cycles: int) -> float:
    return _median_us(lambda k: sampler.sample(SYNC_S * k), stopwatch, n_cycles)


def _playing_us(world: World, stopwatch: Callable[[], int], n_cycles: int) -> float:
    player = Player(world)
    return _median_us(lambda k: player.cycle(), stopwatch, n_cycles)


def _median_us(cycle: Callable[[int], object], stopwatch: Callable[[], int], n_cycles: int) -> float:
    times = np.empty(n_cycles)
    for k in range(n_cycles):
        begin = stopwatch()
        cycle(k)
        times[k] = stopwatch() - begin
    return float(np.median(times[n_cycles // 10 :])) / 1e3
