"""The cases of the study: arms of one kind of board, random touches, and the true pressures of a layer.

A family says what happens: one touch on a board, two on a board, one across a seam, five on a forearm of 24
boards. A law says what is true and what is fitted: the cone by the cone, as in the paper; or an elastic layer
under disc-shaped tactels, by a cone or by the radial law that a calibration gives. Forces and places are
random; a seed, a family, a density and a law fix them, whatever method looks at them.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.model import Arm, Cone, Law, Link, Patch, PlacedPatch, Radial, Surface, Transducer
from skinbus.model.patch import grid
from skinbus.sim.bonded_layer import profile
from skinbus.sim.laws import ConeSettings, Elastic, LayerSettings
from skinbus.sim.layer import Geometry, Loads

Floats = npt.NDArray[np.float64]

FAMILIES: Final = ("one", "two", "seam", "forearm")
LAWS: Final = ("cone", "elastic-cone", "elastic-radial")
PITCHES: Final = {3: 0.016, 4: 0.010, 6: 0.008, 8: 0.006}
"""Pitch by tactels per side, m; each fits a board of 50 mm, the second is the paper's."""

BOARD: Final = 0.050
GAP: Final = 0.001
"""Between boards at a seam, m."""
FULL_SCALE: Final = 250e3
NOISE: Final = 200.0
"""Pa: 1 % of the peak under a usual touch, as in the EDS files."""
THRESHOLD: Final = 1000.0
INDENTER: Final = 0.006
"""Radius of the fingertip, m."""
FORCES: Final = (2.0, 12.0)
"""N, evenly spread in the logarithm."""
CONE_SLOPE: Final = 4e6
"""Pa/m: the cone nearest to the elastic layer of 6 mm."""
APART: Final = {"two": 0.018, "forearm": 0.045}
"""Least distance of touches, m."""

_THICKNESS, _POISSON = 6e-3, 0.48
_RADIAL_STEP, _RADIAL_POINTS = 0.75e-3, 64  # the table of the patch EDS


@dataclass(frozen=True, slots=True)
class Trial:
    """One cycle: touches (n, 3) of s, a (m), force (N), and the readings of them, (n_tactels,) Pa."""

    touches: Floats
    pressures: Floats


class Case:
    """An arm, its truth, and random cycles of it."""

    def __init__(self, family: str, *, side: int, law: str, bits: int, seed: int) -> None:
        self.family, self.law = family, law
        diameter = min(9.53e-3, 0.95 * PITCHES[side])
        patch = Patch(
            tactels_uv=grid(side, side, PITCHES[side]),
            diameter=diameter,
            transducer=Transducer(full_scale=FULL_SCALE, bits=bits),
            law=_fitted(law, diameter),
            threshold=THRESHOLD,
            release=0.7 * THRESHOLD,
            noise=NOISE,
        )
        self.arm = _arm(family, patch)
        self.n_touches = {"one": 1, "two": 2, "seam": 1, "forearm": 5}[family]
        # The same bits or not: the draws of a case do not depend on them, so only rounding differs.
        self._rng = np.random.default_rng([seed, zlib.crc32(f"{family} {side} {law}".encode())])
        self._step = patch.transducer.step
        layer: LayerSettings = ConeSettings(slope_pa_per_m=CONE_SLOPE) if law == "cone" else Elastic()
        self._truth = layer.bind(Geometry.of(self.arm, discs=layer.discs), np.array([INDENTER]))
        self._loads = Loads(self.n_touches)
        self._touched = np.zeros(self.arm.n_patches, np.bool_)

    @property
    def sigma(self) -> float:
        """Standard deviation of a reading: noise and rounding, Pa."""
        return math.hypot(NOISE, self._step / math.sqrt(12.0))

    def predict(self, touches: Floats) -> Floats:
        """Return the true pressures of touches (n, 3), (n_tactels,) Pa."""
        pressures = np.zeros(self.arm.n_tactels)
        loads = self._loads
        loads.n = len(touches)
        loads.s[: loads.n], loads.a[: loads.n], loads.force[: loads.n] = touches.T
        self._truth.add(loads, pressures, self._touched)
        return pressures

    def trial(self) -> Trial:
        """Return the next cycle."""
        touches = self._touches()
        noisy = self.predict(touches) + self._rng.normal(0.0, NOISE, self.arm.n_tactels)
        counts = np.clip(np.rint(noisy / self._step), 0, round(FULL_SCALE / self._step))
        return Trial(touches, counts * self._step)

    def counts(self, pressures: Floats) -> npt.NDArray[np.int64]:
        """Return what the converters make of pressures, (n_tactels,)."""
        return np.rint(pressures / self._step).astype(np.int64)

    def _touches(self) -> Floats:
        surface = self.arm.links[0].surface
        apart = APART.get(self.family, 0.0)
        rows: list[tuple[float, float]] = []
        while len(rows) < self.n_touches:
            s, a = self._place()
            if all(float(surface.distance(s, a, *row)) >= apart for row in rows):
                rows.append((s, a))
        low, high = np.log(FORCES)
        forces = np.exp(self._rng.uniform(low, high, self.n_touches))
        return np.column_stack([np.array(rows), forces])

    def _place(self) -> tuple[float, float]:
        """Return where the next touch of a family may be, (s, a) m."""
        draw, surface = self._rng.uniform, self.arm.links[0].surface
        if self.family == "forearm":
            margin, half = 0.010, 0.5 * surface.period - 0.5 * BOARD  # users' K-means does not wrap
            return draw(margin, surface.length - margin), draw(-half, half)
        across = 0.004 if self.family == "seam" else 0.015
        return 0.5 * BOARD + draw(-0.015, 0.015), draw(-across, across)


def _fitted(law: str, diameter: float) -> Law:
    """Return the law that the estimator is given."""
    if law != "elastic-radial":
        return Cone(CONE_SLOPE)
    d = _RADIAL_STEP * np.arange(_RADIAL_POINTS)
    k = profile(
        d,
        thickness=_THICKNESS,
        poisson=_POISSON,
        tactel_radius=0.5 * diameter,
        indenter_radius=INDENTER,
    )
    return Radial(_RADIAL_STEP, k)


def _arm(family: str, patch: Patch) -> Arm:
    pitch = BOARD + GAP
    if family == "forearm":
        link = Link("forearm", Surface.cylinder(3 * pitch, 8 * pitch / math.tau))
        places = [((ring + 0.5) * pitch, (k - 3.5) * pitch) for ring in range(3) for k in range(8)]
    elif family == "seam":
        link = Link("plate", Surface.plane(BOARD, 2 * pitch))
        places = [(0.5 * BOARD, -0.5 * pitch), (0.5 * BOARD, 0.5 * pitch)]
    else:
        link = Link("plate", Surface.plane(BOARD, BOARD))
        places = [(0.5 * BOARD, 0.0)]
    placed = [PlacedPatch(patch=patch, node_id=k, link=0, s=s, a=a) for k, (s, a) in enumerate(places, 1)]
    return Arm(family, [link], placed)
