"""Effects on the boards' clocks and on what their nodes receive and send."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import NormalDist

import numpy as np

from skinbus.arrays import Floats
from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.errors import Fault
from skinbus.model import Arm
from skinbus.objects.cia import EMCY_BASE, NMT_COMMAND_ID, EmcyCode, NmtCommand
from skinbus.sim.effect import (
    Effect,
    FrameStep,
    Rng,
    TrafficEffect,
    at,
    node_of,
    parameter,
    settings,
    unknown_nodes,
)

_REGISTER = 0x11  # generic and communication error, CiA 301, 7.5.2.2


@settings
class ClockDrift(Effect):
    """Every board's oscillator is a little off, and with it heartbeats, event and inhibit times."""

    # crystals are specified to +-30 to +-50 ppm; RC oscillators of microcontrollers to 1 % (10 000 ppm)
    sigma_ppm: float = parameter(30.0, "ppm", "standard deviation of the rate", ge=0, le=100_000)

    def bind(self, arm: Arm, rng: Rng) -> Callable[[Floats], Floats]:
        """Return ``step(ppm) -> ppm``."""
        rates = self.sigma_ppm * rng.standard_normal(arm.n_patches)
        return lambda ppm: ppm + rates


def _reset(node_id: int, now_ns: int) -> Frame:
    """Return what makes one node start again; only the simulated nodes receive it."""
    return Frame(NMT_COMMAND_ID, bytes([NmtCommand.RESET_NODE, node_id]), now_ns)


class _Resets(FrameStep):
    def __init__(self, effect: PatchReset, arm: Arm, rng: Rng) -> None:
        super().__init__(effect, arm, rng)
        self._named = sorted((t_s, node_id) for node_id, t_s in effect.resets)
        self._mean_s = 3600.0 / effect.per_hour if effect.per_hour else np.inf
        self.next_s = self._mean_s * rng.standard_exponential(arm.n_patches)

    def receive(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        while self._named and self._named[0][0] <= t_s:
            frames.insert(0, _reset(self._named.pop(0)[1], now_ns))
        while self.next_s.min() <= t_s:
            patch = int(self.next_s.argmin())
            frames.insert(0, _reset(int(self.arm.node_id[patch]), now_ns))
            self.next_s[patch] += self._mean_s * self.rng.standard_exponential()


@settings
class PatchReset(TrafficEffect):
    """Boards brown out, start again and say so: named ones at named times, and all at random."""

    step = _Resets
    resets: tuple[tuple[int, float], ...] = parameter((), "", "[node-ID, scene time in s] pairs")
    # assumed: loose contacts in a moving arm
    per_hour: float = parameter(1.0, "1/h", "mean number of resets of every board", ge=0)

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return faults for node-IDs that the arm does not have."""
        return unknown_nodes(arm, "resets", [node_id for node_id, _ in self.resets])


class _Silence(FrameStep):
    def receive(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        effect = self.effect
        if t_s >= effect.from_s and (effect.to_s is None or t_s < effect.to_s):
            self.deaf = frozenset(effect.nodes)
        elif self.deaf:
            frames[:0] = [_reset(node_id, now_ns) for node_id in sorted(self.deaf)]
            self.deaf = frozenset()


@settings
class PatchSilent(TrafficEffect):
    """Boards that lose their plug, receive nothing and send nothing; those that come back boot."""

    step = _Silence
    # by default nobody is silent: which boards fail, and when, is what a scene is about
    nodes: tuple[int, ...] = parameter((), "", "node-IDs of the boards")
    from_s: float = parameter(0.0, "s", "scene time at which they go", ge=0)
    to_s: float | None = parameter(None, "s", "scene time at which they are back; never if not given", gt=0)

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return faults for node-IDs that the arm does not have, and for a return before the loss."""
        faults = unknown_nodes(arm, "nodes", self.nodes)
        if self.to_s is not None and self.to_s <= self.from_s:
            faults.add("to_s", self.to_s, f"later than from_s, {self.from_s:g}")
        return faults


class _Off(FrameStep):
    _back: Sequence[int] = ()

    def receive(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        effect = self.effect
        if effect.at_s <= t_s < effect.at_s + effect.recovery_s:
            self.deaf = frozenset(effect.nodes)
        elif self.deaf:
            self._back, self.deaf = sorted(self.deaf), frozenset()

    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        super().say(now_ns, t_s, frames)
        for node_id in self._back:
            code = int(EmcyCode.BUS_OFF_RECOVERED).to_bytes(2, "little")
            frames.append(Frame(EMCY_BASE + node_id, code + bytes([_REGISTER]) + bytes(5), now_ns))
        self._back = ()


@settings
class BusOff(TrafficEffect):
    """Boards receive and send nothing for a while, keep running, and report it when they are back."""

    step = _Off
    nodes: tuple[int, ...] = parameter((), "", "node-IDs of the boards")
    at_s: float = parameter(0.0, "s", "scene time at which they go off", ge=0)
    # ISO 11898-1 asks for 128 x 11 recessive bits, 1.4 ms; firmware waits longer so as not to come back at
    # once
    recovery_s: float = parameter(0.5, "s", "time off the bus", gt=0)

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return faults for node-IDs that the arm does not have."""
        return unknown_nodes(arm, "nodes", self.nodes)


class _LateAnswers(FrameStep):
    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        late: dict[int, int] = {}
        for i, frame in enumerate(frames):
            node_id = node_of(frame)
            if node_id not in late:
                share = next(self.draws[frame.can_id])
                late[node_id] = round(1e3 * self.effect.sigma_us * NormalDist().inv_cdf(0.5 + 0.5 * share))
            frames[i] = at(frame, frame.t_ns + late[node_id])


@settings
class ResponseJitter(TrafficEffect):
    """Nodes take their time between SYNC and TPDOs; what one says at a time is late together."""

    step = _LateAnswers
    # assumed: firmware that serves SYNC from a task of 1 kHz, not from its interrupt
    sigma_us: float = parameter(300.0, "us", "root mean square of the lateness", ge=0)


class _Babble(FrameStep):
    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        effect = self.effect
        if not effect.rate_hz or t_s < effect.from_s or (effect.to_s is not None and t_s >= effect.to_s):
            self.wake_ns = NEVER
            return
        if self.wake_ns == NEVER:
            self.wake_ns = now_ns
        while self.wake_ns <= now_ns:
            frames.append(Frame(effect.can_id, self.rng.bytes(8), now_ns))
            self.wake_ns += round(1e9 / effect.rate_hz)


@settings
class BabblingNode(TrafficEffect):
    """A faulty controller fills the bus with frames of eight random bytes that nobody asked for."""

    step = _Babble
    # an identifier that CiA 301 restricts (table 41), below every PDO: the babbler wins each arbitration
    can_id: int = parameter(0x010, "", "identifier of the frames", ge=0, le=0x7FF)
    # assumed: some 13 % of 1 Mbit/s
    rate_hz: float = parameter(1000.0, "Hz", "frames per second", ge=0, le=8000)
    from_s: float = parameter(0.0, "s", "scene time of the first", ge=0)
    to_s: float | None = parameter(None, "s", "scene time of the last; never if not given", gt=0)


class _Spoil(FrameStep):
    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        for i, frame in enumerate(frames):
            numbers = self.draws[frame.can_id]
            if next(numbers) >= self.effect.probability or not frame.data:
                continue
            data = bytearray(frame.data)
            if next(numbers) < self.effect.length_share:
                del data[int(len(data) * next(numbers)) :]
            else:
                bit = int(8 * len(data) * next(numbers))
                data[bit // 8] ^= 1 << bit % 8
            frames[i] = frame._replace(data=bytes(data))


@settings
class Corrupt(TrafficEffect):
    """Faulty firmware: some frames are spoilt, cut short, or one bit of their data turned."""

    step = _Spoil
    # assumed; damage on the wire is caught by CAN's checksum, so what is left is wrong before it is sent
    probability: float = parameter(0.001, "", "of a frame to be spoilt", ge=0, le=1)
    length_share: float = parameter(0.5, "", "of those, cut short; the others lose a bit", ge=0, le=1)


class _LateFrames(FrameStep):
    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        constant_ns, mean_ns = 1e3 * self.effect.constant_us, 1e3 * self.effect.mean_us
        for i, frame in enumerate(frames):
            late_ns = constant_ns - mean_ns * math.log1p(-next(self.draws[frame.can_id]))
            frames[i] = at(frame, frame.t_ns + int(late_ns))


@settings
class Delay(TrafficEffect):
    """Gateways and busy controllers: every frame is late, by a constant and an exponential time."""

    step = _LateFrames
    # assumed: a CAN gateway that stores a frame and forwards it, some 130 us a frame, with a short queue
    constant_us: float = parameter(150.0, "us", "lateness of every frame", ge=0)
    mean_us: float = parameter(100.0, "us", "mean of the random part", ge=0)


class _Lose(FrameStep):
    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        p = self.effect.probability
        frames[:] = [frame for frame in frames if next(self.draws[frame.can_id]) >= p]


@settings
class Loss(TrafficEffect):
    """Each frame of the patches is lost with the same probability, as when receive buffers overflow."""

    step = _Lose
    # assumed; CAN itself repeats damaged frames, so what is lost is lost in controllers and drivers
    probability: float = parameter(0.001, "", "of a frame to be lost", ge=0, le=1)
