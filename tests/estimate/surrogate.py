"""Surrogates of a measured array: eight barometers under rubber, with the scatter that such arrays show.

The figures are those of recordings of real arrays: a law of 6.5 mm full width at half maximum; from tactel
to tactel gains by 10 %, widths by 4 %, ellipses of ratio 1.03, offsets of 0.2 % of the peak; beyond that a
smooth residual, up to 0.9 % of the peak at 8 mm, correlated over 8 mm; one press in 500 is recorded 5 mm away
from where it was. The load is constant and unknown, as with a weight on a guided tip.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.model import Arm, Transducer
from skinbus.model.patch import grid
from skinbus.sim.bonded_layer import profile

Floats = npt.NDArray[np.float64]

THICKNESS: Final = 0.0062
"""m: with a tip of 2 mm and tactels of 2 mm, a full width at half maximum of 6.5 mm."""
POISSON: Final = 0.48
RADIUS: Final = 0.001
"""m, of the tip and of the port of a tactel."""
GAINS: Final = 0.10
WIDTHS: Final = 0.04
ELLIPSE: Final = 1.03
OFFSETS: Final = 0.002
"""Of the peak, standard deviation."""
RESIDUAL_AT: Final = np.array([0.0, 1.0, 5.0, 8.0, 12.0, 20.0, 30.0]) * 1e-3
RESIDUAL: Final = np.array([0.04, 0.04, 0.2, 0.9, 0.6, 0.2, 0.0]) * 1e-2
"""Root mean square of the smooth residual, of the peak, at those distances."""
CORRELATION: Final = 0.008
"""m, of the smooth residual: a Gaussian with this standard deviation."""
NOISE: Final = 0.001
"""Of the peak: a barometer's own noise after averaging."""
PEAK: Final = 20e3
"""Pa under the load of the presses; the load itself is not given."""
MISLABELLED: Final = 1.0 / 500.0
MISLABELLED_BY: Final = 0.005
"""m"""
WAVES: Final = 200
"""Of a smooth random field; more change nothing in its statistics up to second order."""
FULL_SCALE: Final = 100e3


@dataclass(frozen=True, slots=True)
class Presses:
    """Presses as recorded: places as stated (m), readings (n, n_tactels) Pa, and which places are wrong."""

    s: Floats
    a: Floats
    readings: Floats
    mislabelled: npt.NDArray[np.intp]


class Surrogate:
    """One array drawn at random: what it reads when pressed, and presses all over it."""

    def __init__(self, pitch: float, rng: np.random.Generator, *, columns: int = 4, rows: int = 2) -> None:
        self.pitch = pitch
        self.arm = Arm.single_patch(
            grid(columns, rows, pitch),
            transducer=Transducer(full_scale=FULL_SCALE),
            threshold=0.02 * PEAK,
            release=0.015 * PEAK,
            noise=NOISE * PEAK,
            diameter=2.0 * RADIUS,
        )
        n = self.arm.n_tactels
        self._rng = rng
        self._distances = np.linspace(0.0, 0.06, 2401)
        law = profile(
            self._distances,
            thickness=THICKNESS,
            poisson=POISSON,
            tactel_radius=RADIUS,
            indenter_radius=RADIUS,
        )
        self._law = PEAK * law / law[0]
        self._gain = np.maximum(1.0 + GAINS * rng.standard_normal(n), 0.5)
        self._width = 1.0 + WIDTHS * rng.standard_normal(n)
        self._offset = OFFSETS * PEAK * rng.standard_normal(n)
        self._angle = rng.uniform(0.0, np.pi, n)
        self._waves = rng.standard_normal((n, WAVES, 2)) / CORRELATION
        self._phases = rng.uniform(0.0, 2.0 * np.pi, (n, WAVES))

    def truth(self, s: npt.ArrayLike, a: npt.ArrayLike, load: npt.ArrayLike = 1.0) -> Floats:
        """Return pressures (n, n_tactels) Pa of presses at places (n,) m, in units of the load, no noise."""
        s, a = np.atleast_1d(np.asarray(s, float)), np.atleast_1d(np.asarray(a, float))
        x = s[:, None] - self.arm.tactel_s
        y = a[:, None] - self.arm.tactel_a
        cos, sin = np.cos(self._angle), np.sin(self._angle)
        along, across = cos * x + sin * y, cos * y - sin * x
        stretched = np.hypot(along / np.sqrt(ELLIPSE), across * np.sqrt(ELLIPSE)) / self._width
        law = self._gain * np.interp(stretched, self._distances, self._law)
        phase = np.einsum("ijk,jmk->ijm", np.stack([x, y], -1), self._waves) + self._phases
        field = np.sqrt(2.0 / WAVES) * np.cos(phase).sum(axis=-1)
        residual = PEAK * np.interp(np.hypot(x, y), RESIDUAL_AT, RESIDUAL) * field
        return np.asarray(np.broadcast_to(load, s.shape)[:, None] * (law + residual) + self._offset)

    def read(self, s: npt.ArrayLike, a: npt.ArrayLike, load: npt.ArrayLike = 1.0) -> Floats:
        """Return the same with the noise of the readings."""
        truth = self.truth(s, a, load)
        return np.asarray(truth + NOISE * PEAK * self._rng.standard_normal(truth.shape))

    def presses(self, n: int, *, mislabelled: int | None = None) -> Presses:
        """Return presses all over the hull of the tactels; one in 500 mislabelled, or as many as wanted."""
        s, a = self.places(n)
        readings = self.read(s, a)
        if mislabelled is None:
            wrong = np.flatnonzero(self._rng.random(n) < MISLABELLED)
        else:
            wrong = self._rng.choice(n, mislabelled, replace=False)
        angle = self._rng.uniform(0.0, 2.0 * np.pi, len(wrong))
        s[wrong] += MISLABELLED_BY * np.cos(angle)
        a[wrong] += MISLABELLED_BY * np.sin(angle)
        return Presses(s, a, readings, wrong)

    def places(self, n: int) -> tuple[Floats, Floats]:
        """Return random places (n,) m within the hull of the tactels."""
        arm = self.arm
        return (
            self._rng.uniform(arm.tactel_s.min(), arm.tactel_s.max(), n),
            self._rng.uniform(arm.tactel_a.min(), arm.tactel_a.max(), n),
        )
