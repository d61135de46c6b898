"""What an effect is: frozen parameters, the stage at which it acts, and ``bind(arm, rng) -> step``.

An effect holds no state: ``bind`` returns a step that does. Steps of one stage have one signature::

    TIME      step(t_s) -> t_s                       when a sample is really taken
    GEOMETRY  step(geometry)                         once, before the layer is bound: where tactels are,
                                                     how they respond, how loads act
    LAYER     step(pressures, t_s) -> pressures      (n_tactels,) Pa: what arrives at the base of the layer
    TACTEL    step(pressures, t_s) -> pressures      (n_tactels,) Pa: the output of tactels and electronics
    COUNTS    step(counts, t_s) -> counts            (n_tactels,) int32, left-adjusted
    CLOCK     step(ppm) -> ppm                       once: (n_patches,) by how much each board's clock is fast
    FRAMES    a FrameStep                            what the nodes receive and send

Physics fixes the order: stages as above, and within a stage the order of ``EFFECTS``. The order in a
scene file says nothing. Zero strength is the identity, bit for bit.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import Any, ClassVar, TypeVar, dataclass_transform

import numpy as np
from pydantic import ConfigDict

from skinbus.arrays import Floats, Ints32
from skinbus.can.core import NEVER
from skinbus.can.frame import CobIds, Frame
from skinbus.errors import Fault, FaultList
from skinbus.model import Arm

T = TypeVar("T")
Rng = np.random.Generator

PressureStep = Callable[[Floats, float], Floats]
CountStep = Callable[[Ints32, float], Ints32]

_BLOCK = 256
_make = tuple.__new__  # half the time of Frame(...), and a scene makes every frame late


class Stage(IntEnum):
    """Where an effect acts, in the order of physics."""

    TIME = 0
    GEOMETRY = 1
    LAYER = 2
    TACTEL = 3
    COUNTS = 4
    CLOCK = 5
    FRAMES = 6


EFFECTS = {
    Stage.TIME: ("sync_jitter",),
    Stage.GEOMETRY: ("misplaced", "response", "shear"),
    # what arrives at the base of the layer
    Stage.LAYER: ("bend", "viscoelastic", "hysteresis"),
    # the film, the matrix, the amplifier
    Stage.TACTEL: (
        *("gain_spread", "piezoresistive", "thermal", "drift", "dead", "crosstalk"),
        *("offset", "noise", "burst", "saturation"),
    ),
    # the converter and what its firmware makes of it
    Stage.COUNTS: ("adc", "stuck"),
    Stage.CLOCK: ("clock_drift",),
    # the boards' own faults, then those of the way
    Stage.FRAMES: (
        *("patch_reset", "patch_silent", "bus_off"),
        *("response_jitter", "babbling_node", "corrupt", "delay", "loss"),
    ),
}
"""The effects that a scene may name, in the order in which physics applies them."""
STAGE_OF = {name: stage for stage, names in EFFECTS.items() for name in names}
ORDER = tuple(STAGE_OF)


@dataclass_transform(kw_only_default=True, frozen_default=True)
def settings(cls: type[T]) -> type[T]:
    """Make a class the parameters of a table of a scene file, see :func:`parameter`."""
    made = dataclass(frozen=True, slots=True, kw_only=True)(cls)
    made.__pydantic_config__ = ConfigDict(  # type: ignore[attr-defined]
        strict=True, extra="forbid", allow_inf_nan=False
    )
    return made


def parameter(default: Any, unit: str, text: str, **limits: Any) -> Any:
    """Return what a parameter is: its default, unit, a line on it, and limits (ge, gt, le, lt)."""
    return field(default=default, metadata={"title": unit, "description": text, **limits})


class Effect:
    """Parameters of one effect; subclasses are :func:`settings`, called as the effect in camel case."""

    __slots__ = ()
    name: ClassVar[str]
    stage: ClassVar[Stage]

    def __init_subclass__(cls) -> None:
        cls.name = re.sub("(?<!^)(?=[A-Z])", "_", cls.__name__).lower()
        cls.stage = STAGE_OF.get(cls.name, Stage.FRAMES)

    def bind(self, arm: Arm, rng: Rng) -> Any:
        """Return the step of this effect on an arm; it draws from ``rng`` and from nothing else."""
        raise NotImplementedError

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return what is wrong with the parameters on this arm, such as a node-ID it does not have."""
        return ()


def at(frame: Frame, t_ns: int) -> Frame:
    """Return a frame that leaves at another time."""
    return _make(Frame, (frame[0], frame[1], t_ns, frame[3], frame[4]))


def on_bus(bus: int, frame: Frame) -> Frame:
    """Return a frame that is on another bus."""
    return _make(Frame, (frame[0], frame[1], frame[2], frame[3], bus))


class FrameStep:
    """What an effect does to the traffic of the simulated nodes of one bus; all of it is optional.

    Where an arm has several buses, an effect is bound once for each.

    ``t_s`` is scene time, that of the last sample; effects begin and end by it.
    """

    def __init__(self, effect: Any, arm: Arm, rng: Rng) -> None:
        self.effect, self.arm, self.rng = effect, arm, rng

    @cached_property
    def draws(self) -> DrawsById:
        """Random numbers by identifier."""
        return DrawsById(self.rng)

    wake_ns: int = NEVER
    """When to be called again at the latest, ns."""
    deaf: CobIds = frozenset()
    """Node-IDs that receive nothing now."""

    def receive(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        """Change, in place, what the nodes receive; called once at power-on with nothing."""

    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        """Change, in place, what the nodes say; called at ``wake_ns`` even when they say nothing.

        The time of a frame is when it leaves: one that is set later makes it late. Nodes that are deaf say
        nothing.
        """
        if self.deaf:
            frames[:] = [frame for frame in frames if node_of(frame) not in self.deaf]


class TrafficEffect(Effect):
    """An effect on the traffic: its class says what takes its steps."""

    __slots__ = ()
    step: ClassVar[type[FrameStep]]

    def bind(self, arm: Arm, rng: Rng) -> FrameStep:
        """Return the step on one bus."""
        return self.step(self, arm, rng)


class DrawsById(dict[int, Iterator[float]]):
    """Random numbers in [0, 1), a stream for each COB-ID: no other frame changes the draws of a PDO.

    ``next(draws[can_id])`` is the next number of an identifier's stream.
    """

    def __init__(self, rng: Rng) -> None:
        super().__init__()
        self._seed = int(rng.integers(2**63))

    def __missing__(self, can_id: int) -> Iterator[float]:
        stream = self[can_id] = _numbers(np.random.Generator(np.random.PCG64DXSM([self._seed, can_id])))
        return stream


def _numbers(rng: Rng) -> Iterator[float]:
    while True:
        yield from rng.random(_BLOCK).tolist()


def node_of(frame: Frame) -> int:
    """Return the node-ID that a frame of the predefined connection set belongs to."""
    return frame.can_id & 0x7F


def unknown_nodes(arm: Arm, key: str, node_ids: Sequence[int]) -> FaultList:
    """Return a fault for each node-ID that the arm does not have."""
    known = set(arm.node_id.tolist())
    wanted = f"node-IDs of arm {arm.name}: {min(known)} to {max(known)}"
    return FaultList(Fault(key, node_id, wanted) for node_id in node_ids if node_id not in known)


def stream(seed: int, name: str, bus: int = 0) -> Rng:
    """Return the random stream of an effect: a function of (seed, name) and the bus it acts on alone."""
    key = [seed, zlib.crc32(name.encode()), *([bus] if bus else [])]
    return np.random.Generator(np.random.PCG64DXSM(np.random.SeedSequence(key)))
