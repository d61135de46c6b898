"""What an effect is: frozen parameters, the stage at which it acts, and ``bind(arm, rng) -> step``.

An effect holds no state: ``bind`` returns a step that does. Steps of one stage have one signature::

    TIME      step(t_s) -> t_s                 when a sample is really taken
    GEOMETRY  step(geometry) -> None           once, before the layer is bound: where tactels really are
    LAYER     step(pressures, t_s) -> None     (n_tactels,) Pa in place: what arrives at the base of the layer
    TACTEL    step(pressures, t_s) -> None     (n_tactels,) Pa in place: what tactels and electronics make of
    it COUNTS    step(counts, t_s) -> None        (n_tactels,) int32 in place, left-adjusted
    CLOCK     step(ppm) -> None                once: (n_patches,) by how much each board's clock is fast
    FRAMES    a FrameStep                      what the nodes hear and say

Physics fixes the order: stages as above, and within a stage the order of ``effects.ORDER``. The order in a
scene file says nothing. Zero strength is the identity, bit for bit.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import ConfigDict, Field

from skinbus.bus.core import NEVER
from skinbus.bus.frame import Frame
from skinbus.errors import Fault
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]

PressureStep = Callable[[Floats, float], None]
CountStep = Callable[[Ints, float], None]


class Stage(IntEnum):
    """Where an effect acts, in the order of physics."""

    TIME = 0
    GEOMETRY = 1
    LAYER = 2
    TACTEL = 3
    COUNTS = 4
    CLOCK = 5
    FRAMES = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """Parameters of one effect; subclasses say what a parameter is by :func:`parameter`."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
    name: ClassVar[str]
    stage: ClassVar[Stage]

    def bind(self, arm: Arm, rng: np.random.Generator) -> Any:
        """Return the step of this effect on an arm; it draws from ``rng`` and from nothing else."""
        raise NotImplementedError

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return what is wrong with the parameters on this arm, such as a node-ID it does not have."""
        return ()


class FrameStep:
    """What an effect does to the traffic of the simulated nodes; all of it is optional."""

    wake_ns: int = NEVER
    """When to be called again at the latest, ns."""

    def hear(self, now_ns: int, frames: list[Frame]) -> None:
        """Change, in place, what the nodes hear."""

    def say(self, now_ns: int, frames: list[Frame]) -> None:
        """Change, in place, what the nodes say; called at ``wake_ns`` even when they say nothing."""


def parameter(unit: str, text: str, **limits: Any) -> Any:
    """Return what a parameter is, for ``Annotated``: its unit, a line on it, and limits (ge, gt, le, lt)."""
    return Field(title=unit, description=text, **limits)


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the random stream of an effect: a function of (seed, name) alone."""
    return np.random.Generator(np.random.PCG64DXSM(np.random.SeedSequence([seed, zlib.crc32(name.encode())])))
