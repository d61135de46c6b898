"""Effects on what arrives at the base of the layer, on tactels and electronics, and on the converter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from skinbus.arrays import Floats, Ints32
from skinbus.errors import Fault
from skinbus.model import Arm
from skinbus.sim.effect import (
    CountStep,
    Effect,
    PressureStep,
    Rng,
    parameter,
    settings,
    unknown_nodes,
)

_EULER = math.exp(0.5772156649015329)
"""The sum of 1 - exp(-t/tau) over decades of tau is log10(t/first) + 1/2 + log10(e^gamma) in the middle."""
_OVER = 5.0
"""Durations after which a burst is over: 0.7 % of it is left."""


class _Lag:
    """First-order states that follow the pressures, exact for pressures that are constant over a step."""

    def __init__(self, tau_s: Any, shape: Any) -> None:
        self._tau_s, self._state, self._last_s = tau_s, np.zeros(shape), math.nan

    def follow(self, pressures: Floats, t_s: float) -> Floats:
        """Return the states at a time (s)."""
        elapsed = np.fmax(t_s - self._last_s, 0.0)  # 0 at the first sample, and where a scene begins anew
        self._last_s = t_s
        self._state -= np.expm1(-elapsed / self._tau_s) * (pressures - self._state)
        return self._state


@settings
class Bend(Effect):
    """The preload of flat boards that are strapped to a curved link.

    A flat board touches a cylinder of radius r along one line and stands off by w^2 / (2 r) at distance w
    from it around the link. What holds it down presses there, in proportion to the stand-off.
    """

    # assumed: a sleeve of 10 N over a board's edge, 1.7 mm off a forearm of 65 mm, gives some 1 kPa there
    kpa_per_mm: float = parameter(0.5, "kPa/mm", "pressure per stand-off from the link", ge=0)

    def bind(self, arm: Arm, rng: Rng) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``, which adds the preload."""
        preload = np.zeros(arm.n_tactels)
        for p, placed in enumerate(arm.patches):
            surface, at = arm.links[placed.link].surface, arm.tactels_of(p)
            if surface.period > 0.0:
                radius = surface.radius_at(arm.tactel_s[at])
                around = surface.wrap(arm.tactel_a[at] - placed.a) * radius / surface.radius
                preload[at] = 1e6 * self.kpa_per_mm * around**2 / (2.0 * radius)
        return lambda pressures, t_s: pressures + preload


@settings
class Viscoelastic(Effect):
    """A layer that relaxes under held position, or creeps under held force: a standard linear solid.

    It has modulus E0 at once and E0 (1 - R) in the end. Held in position, its pressure relaxes,

        p(t) = p0 (1 - R (1 - exp(-t / tau)));

    held by a constant force, its strain, and with it what a film below reads, creeps,

        p(t) = p0 (1 + c (1 - exp(-t / tau_c))),   c = R / (1 - R),   tau_c = tau / (1 - R).

    Source: W. N. Findley, J. S. Lai, K. Onaran, Creep and Relaxation of Nonlinear Viscoelastic Materials,
    1976, 5.
    """

    # assumed: soft silicones (Ecoflex, Sylgard) do relax (doi 10.1089/soro.2015.0002), filled ones more than
    # others
    relaxation: float = parameter(0.1, "", "share of the modulus that relaxes", ge=0, lt=1)
    tau_s: float = parameter(1.0, "s", "time constant of the relaxation", gt=0)
    control: Literal["force", "position"] = parameter(
        "force", "", "what a touch holds: its force, or its position"
    )

    def bind(self, arm: Arm, rng: Rng) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        left = 1.0 - self.relaxation
        gain, tau = (self.relaxation / left, self.tau_s / left)
        if self.control == "position":
            gain, tau = -self.relaxation, self.tau_s
        lag = _Lag(tau, arm.n_tactels)
        return lambda pressures, t_s: pressures + gain * lag.follow(pressures, t_s)


@settings
class Hysteresis(Effect):
    """A tactel reads less while the load grows than while it falls: play about the pressure.

    The reading stays where it is until the load has moved by the width, then follows at the edge. It does not
    depend on the rate, and closes at zero load.

        y <- min(max(y, p - w |p|), p + w |p|),   w = loop / 2

    Source: A. Visintin, Differential Models of Hysteresis, 1994, III (play).
    """

    # FlexiForce A201 datasheet: hysteresis < 4.5 % of full scale, conditioned, at 80 % of full force
    loop: float = parameter(0.045, "", "width of the loop, as a share of the pressure", ge=0, lt=1)

    def bind(self, arm: Arm, rng: Rng) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        state = np.zeros(arm.n_tactels)

        def step(pressures: Floats, t_s: float) -> Floats:
            width = 0.5 * self.loop * np.abs(pressures)
            state[:] = np.clip(state, pressures - width, pressures + width)
            return state.copy()

        return step


@settings
class GainSpread(Effect):
    """Tactels differ in sensitivity from what their calibration says, fixed for the run."""

    # FlexiForce A201 datasheet: repeatability +-2.5 %, what calibration leaves at best
    sigma: float = parameter(0.025, "", "standard deviation of the factor about 1", ge=0, le=1)

    def bind(self, arm: Arm, rng: Rng) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        factor = 1.0 + self.sigma * rng.standard_normal(arm.n_tactels)
        return lambda pressures, t_s: pressures * factor


@settings
class Piezoresistive(Effect):
    """The curve of tactel and circuit, right at zero and at full scale.

    Conductance grows with force. An inverting amplifier is proportional to it, a divider with a load resistor
    is not: with k, ``load_ratio``, the load resistor over the tactel's resistance at full scale,

        y = p (1 + k) / (1 + k p / full scale).

    On top, each tactel bends by its own share of ``linearity``: 4 l x (1 - x) of full scale at x = p / full
    scale. Source: Tekscan FlexiForce integration guide (inverting amplifier); D. Fraden, Handbook of Modern
    Sensors, 6.2.
    """

    load_ratio: float = parameter(0.3, "", "load resistor over resistance at full scale; 0: inverting", ge=0)
    # FlexiForce A201 datasheet and user manual rev. G, p. 13: linear within +-3 % of full scale
    linearity: float = parameter(0.03, "", "largest bend, as a share of full scale", ge=0, le=0.2)

    def bind(self, arm: Arm, rng: Rng) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        ratio = self.load_ratio
        bend = 4.0 * self.linearity * rng.uniform(-1.0, 1.0, arm.n_tactels)
        full_scale = _of_boards(arm, [placed.patch.transducer.full_scale for placed in arm.patches])

        def step(pressures: Floats, t_s: float) -> Any:
            x = np.clip(pressures / full_scale, 0.0, 1.0)
            return pressures * ((1.0 + ratio) / (1.0 + ratio * x)) + bend * x * (1.0 - x) * full_scale

        return step


@settings
class Thermal(Effect):
    """Boards warm up, and with them the zeros and the gains of their tactels, touched or not.

    Each board's temperature goes from ``start_c`` to ``end_c``, differences from that of calibration, with
    one time constant; boards differ in how far it goes. A zero follows its board by a coefficient that all
    tactels have in common and a part of its own.
    """

    # a robot arm's motors warm its skin by some 10 degrees within the first half hour (assumed)
    start_c: float = parameter(0.0, "K", "difference from calibration at scene time 0")
    end_c: float = parameter(10.0, "K", "difference from calibration in the end")
    tau_s: float = parameter(600.0, "s", "time constant of the warm-up; 0 is at once", ge=0)
    # near a motor or away from it (assumed)
    board_sigma_c: float = parameter(2.0, "K", "standard deviation between boards", ge=0)
    # gas enclosed over a barometer, p/T = 101 325 Pa / 293 K (Gay-Lussac), of which firmware that has the
    # temperature of its own converter leaves half (assumed)
    zero_pa_per_k: float = parameter(170.0, "Pa/K", "change of all zeros per degree")
    zero_sigma_pa_per_k: float = parameter(20.0, "Pa/K", "standard deviation of that between tactels", ge=0)
    # FlexiForce A201 datasheet: output changes by 0.36 % per degree C
    per_degree: float = parameter(0.0036, "1/K", "change of sensitivity per degree", ge=-0.1, le=0.1)

    def bind(self, arm: Arm, rng: Rng) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        further = _of_boards(arm, self.board_sigma_c * rng.standard_normal(arm.n_patches))
        zero = self.zero_pa_per_k + self.zero_sigma_pa_per_k * rng.standard_normal(arm.n_tactels)

        def step(pressures: Floats, t_s: float) -> Any:
            left = math.exp(-max(t_s, 0.0) / self.tau_s) if self.tau_s > 0.0 else 0.0
            degrees = further * (1.0 - left) + (self.end_c + (self.start_c - self.end_c) * left)
            return pressures * (1.0 + self.per_degree * degrees) + zero * degrees

        return step


@settings
class Drift(Effect):
    """Under constant load the reading keeps growing, by a share of the load in every decade of time.

        y(t) = p (1 + d log10(1 + t / t0))    for a load p since t = 0

    A sum of first-order states with time constants one decade apart, each with weight d, grows like that from
    t0 on (the ripple is 2 % of one decade's drift), and recovers in the same way when the load is gone.
    """

    # FlexiForce A201 datasheet: drift < 5 % per logarithmic time scale, at 90 % of full load
    per_decade: float = parameter(0.05, "", "share of the load gained per decade of time", ge=0, le=1)
    first_s: float = parameter(1.0, "s", "where the logarithm begins", gt=0)
    decades: int = parameter(5, "", "decades that the drift lasts", ge=1, le=12)

    def bind(self, arm: Arm, rng: Rng) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        # log10(1 + t/t0) is the sum with the first time constant half a decade, less Euler's constant, above
        # t0
        taus = self.first_s * _EULER * math.sqrt(10.0) * 10.0 ** np.arange(self.decades)[:, None]
        lag = _Lag(taus, (self.decades, arm.n_tactels))
        return lambda pressures, t_s: pressures + self.per_decade * lag.follow(pressures, t_s).sum(axis=0)


@settings
class _FaultyTactels(Effect):
    """Named tactels, and a random share of all, that fail at one time."""

    tactels: tuple[tuple[int, int], ...] = parameter((), "", "[node-ID, tactel] pairs; tactels count from 1")
    # assumed: one tactel in fifty, so that an arm shows some; that they hang: iCub support #1318, #1456
    share: float = parameter(0.02, "", "probability of every tactel to fail", ge=0, le=1)
    from_s: float = parameter(0.0, "s", "scene time at which they fail", ge=0)

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return faults for tactels that the arm does not have."""
        faults = unknown_nodes(arm, "tactels", [node_id for node_id, _ in self.tactels])
        for node_id, number in self.tactels:
            patches = arm.patches_named(node_id)
            n = max((arm.patches[p].patch.n_tactels for p in patches), default=0)
            if patches and not 1 <= number <= n:
                faults.add("tactels", [node_id, number], f"a tactel of 1 to {n}")
        return faults

    def chosen(self, arm: Arm, rng: Rng) -> Any:
        """Return which tactels fail, (n_tactels,)."""
        chosen = rng.random(arm.n_tactels) < self.share
        for node_id, number in self.tactels:
            for patch in arm.patches_named(node_id):
                if number <= arm.patches[patch].patch.n_tactels:
                    chosen[arm.patch_start[patch] + number - 1] = True
        return chosen


@settings
class Dead(_FaultyTactels):
    """Tactels that read nothing from a time on, as with an open line; the noise of the electronics stays."""

    def bind(self, arm: Arm, rng: Rng) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        alive = 1.0 - self.chosen(arm, rng)
        return lambda pressures, t_s: pressures * alive if t_s >= self.from_s else pressures


@settings
class Crosstalk(Effect):
    """In a scanned matrix a tactel reads a share of each other tactel in its row and in its column."""

    # from below 3.3 % (fabric skin, arXiv 2508.20959) to 30 % of a reading in a 4 x 4 array without
    # countermeasures (Improving Accuracy in the Readout of Resistive Sensor Arrays, section 1)
    row: float = parameter(0.01, "", "share of each other tactel of the row", ge=0, le=1)
    column: float = parameter(0.01, "", "share of each other tactel of the column", ge=0, le=1)

    def bind(self, arm: Arm, rng: Rng) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        rows, columns = lines_of(arm)
        own = 1.0 - self.row - self.column

        def step(pressures: Floats, t_s: float) -> Any:
            along, across = (np.bincount(lines, pressures)[lines] for lines in (rows, columns))
            return own * pressures + self.row * along + self.column * across

        return step


def lines_of(arm: Arm) -> Ints32:
    """Return the numbers of row and column of each tactel, (2, n_tactels); no two boards share one."""
    lines = np.zeros((2, arm.n_tactels), np.int32)
    for p, placed in enumerate(arm.patches):
        for k, um in enumerate(np.rint(1e6 * placed.patch.tactels_uv.T[::-1])):
            _, numbers = np.unique(um, return_inverse=True)
            lines[k, arm.tactels_of(p)] = arm.patch_start[p] + numbers
    return lines


@settings
class Offset(Effect):
    """Tactels do not read zero when nothing presses; each zero is fixed for the run."""

    # assumed: 0.1 % of a full scale of 250 kPa, the zero error of an amplifier with 5 mV at 5 V
    sigma_pa: float = parameter(250.0, "Pa", "standard deviation of the zero", ge=0)

    def bind(self, arm: Arm, rng: Rng) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        zero = self.sigma_pa * rng.standard_normal(arm.n_tactels)
        return lambda pressures, t_s: pressures + zero


@settings
class Noise(Effect):
    """Normally distributed noise, white, independent between tactels and samples."""

    # 1 % of the peak of a contact; a board declares 200 Pa (model.Patch)
    sigma_pa: float = parameter(200.0, "Pa", "standard deviation", ge=0)

    def bind(self, arm: Arm, rng: Rng) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        return lambda pressures, t_s: pressures + self.sigma_pa * rng.standard_normal(arm.n_tactels)


@settings
class Burst(Effect):
    """Electromagnetic interference: random bursts on every board, which neighbours and samples share.

    A burst strikes one board: every tactel within ``radius_mm`` of a random one, the farther the less (a
    Gaussian), with one sign, for ``duration_ms``, falling exponentially. IEC 61000-4-4 has such bursts last
    15 ms.
    """

    # assumed: a relay or a motor brake beside one of 24 boards, once in some seconds of work
    per_minute: float = parameter(1.0, "1/min", "mean number on each board", ge=0)
    kpa: float = parameter(20.0, "kPa", "standard deviation of the height", ge=0)
    radius_mm: float = parameter(12.0, "mm", "how far over the board it reaches", gt=0)
    duration_ms: float = parameter(15.0, "ms", "time in which it falls to 1/e", gt=0)

    def bind(self, arm: Arm, rng: Rng) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        mean_s = 60.0 / self.per_minute if self.per_minute > 0.0 else np.inf
        next_s = mean_s * rng.standard_exponential(arm.n_patches)
        begun_s = np.full(arm.n_patches, -np.inf)  # of the last burst of each board
        heights = np.zeros(arm.n_tactels)
        tau_s = 1e-3 * self.duration_ms

        def step(pressures: Floats, t_s: float) -> Any:
            while next_s.min() <= t_s:
                patch = int(next_s.argmin())
                uv = arm.patches[patch].patch.tactels_uv
                height = 1e3 * self.kpa * rng.standard_normal()
                centre = uv[rng.integers(len(uv))]
                squares = ((uv - centre) ** 2).sum(axis=1) / (1e-3 * self.radius_mm) ** 2
                heights[arm.tactels_of(patch)] = height * np.exp(-0.5 * squares)
                begun_s[patch] = next_s[patch]
                next_s[patch] += mean_s * rng.standard_exponential()
            age = (t_s - begun_s) / tau_s
            return pressures + _of_boards(arm, np.where(age > _OVER, 0.0, np.exp(-age))) * heights

        return step


@settings
class Saturation(Effect):
    """Electronics clip before the converter does: no reading is above a limit."""

    # assumed: an amplifier set for 60 % of the boards' full scale of 250 kPa
    limit_kpa: float = parameter(150.0, "kPa", "largest pressure that is resolved", gt=0)

    def bind(self, arm: Arm, rng: Rng) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        return lambda pressures, t_s: np.minimum(pressures, 1e3 * self.limit_kpa)


@settings
class Adc(Effect):
    """A converter of fewer bits than the object, over a range of its own; left-adjusted as in CiA 401."""

    # the converters inside common microcontrollers have 12 bits
    bits: int = parameter(
        12, "", "bits of the converter, sign included; 16 is as fine as the object", ge=2, le=16
    )
    range_kpa: float | None = parameter(
        None, "kPa", "largest pressure; the boards' full scale if not given", gt=0
    )

    def bind(self, arm: Arm, rng: Rng) -> CountStep:
        """Return ``step(counts, t_s) -> counts``."""
        transducers = [placed.patch.transducer for placed in arm.patches]
        full = _of_boards(arm, [float(t.full_counts) for t in transducers])
        top = full
        if self.range_kpa is not None:
            step_pa = _of_boards(arm, [t.step for t in transducers])
            top = np.clip(np.round(1e3 * self.range_kpa / step_pa), 1.0, full)
        # the converter's values spread over its range: 2^(bits - 1) of each sign
        width = np.maximum(1.0, (top + (top == full)) / (1 << (self.bits - 1)))

        def step(counts: Ints32, t_s: float) -> Any:
            n = np.floor(np.clip(counts, -top - 1.0, top) / width + 0.5)
            n -= n * width > top
            return np.rint(n * width).astype(np.int32)

        return step


@settings
class Stuck(_FaultyTactels):
    """Tactels that repeat one reading from a time on, noise and all, as converters and firmware that hang."""

    def bind(self, arm: Arm, rng: Rng) -> CountStep:
        """Return ``step(counts, t_s) -> counts``."""
        chosen = self.chosen(arm, rng)
        frozen: Ints32 | None = None

        def step(counts: Ints32, t_s: float) -> Ints32:
            nonlocal frozen
            if t_s >= self.from_s:
                if frozen is None:
                    frozen = counts[chosen]
                counts[chosen] = frozen
            return counts

        return step


def _of_boards(arm: Arm, values: Any) -> Floats:
    """Return the value of each tactel's board, (n_tactels,)."""
    return np.asarray(np.asarray(values)[arm.tactel_patch])
