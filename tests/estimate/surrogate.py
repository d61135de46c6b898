"""Surrogates of a measured array: eight barometers under rubber, with the scatter that such arrays show.

The figures are those of recordings of real arrays: a law of 6.5 mm full width at half maximum; from tactel
to tactel gains by 10 %, widths by 4 %, ellipses of ratio 1.03, offsets of 0.2 % of the peak; beyond that a
smooth residual, up to 0.9 % of the peak at 8 mm, correlated over 8 mm; one press in 500 is recorded 5 mm away
from where it was. The load is constant and unknown, as with a weight on a guided tip.
"""

from types import SimpleNamespace

import numpy as np

from skinbus.model import Arm, Transducer
from skinbus.model.patch import grid
from skinbus.sim.bonded_layer import profile

TIP = 0.001
"""m, radius of the tip and of the port of a tactel."""
LAYER = {"thickness": 0.0062, "poisson": 0.48, "tactel_radius": TIP, "indenter_radius": TIP}
"""m: with a tip of 2 mm and tactels of 2 mm, a full width at half maximum of 6.5 mm."""
ELLIPSE = 1.03
RESIDUAL_AT = np.array([0.0, 1.0, 5.0, 8.0, 12.0, 20.0, 30.0]) * 1e-3
RESIDUAL = np.array([0.04, 0.04, 0.2, 0.9, 0.6, 0.2, 0.0]) * 1e-2
"""Root mean square of the smooth residual, of the peak, at those distances."""
CORRELATION = 0.008
"""m, of the smooth residual: a Gaussian with this standard deviation."""
PEAK = 20e3
"""Pa under the load of the presses; the load itself is not given."""
NOISE = 0.001 * PEAK
"""Pa: a barometer's own noise after averaging."""
MISLABELLED_BY = 0.005
"""m"""
WAVES = 200
"""Of a smooth random field; more change nothing in its statistics up to second order."""


class Surrogate:
    """One array drawn at random: what it reads when pressed, and presses all over it."""

    def __init__(self, rng):
        self.arm = Arm.single_patch(
            grid(4, 2, 9.9e-3),
            transducer=Transducer(full_scale=100e3),
            threshold=0.02 * PEAK,
            release=0.015 * PEAK,
            noise=NOISE,
            diameter=2.0 * TIP,
        )
        n, self._rng = self.arm.n_tactels, rng
        self._distances = np.linspace(0.0, 0.06, 2401)
        law = profile(self._distances, **LAYER)
        self._law = PEAK * law / law[0]
        self._gain = np.maximum(1.0 + 0.10 * rng.standard_normal(n), 0.5)
        self._width = 1.0 + 0.04 * rng.standard_normal(n)
        self._offset = 0.002 * PEAK * rng.standard_normal(n)
        self._angle = rng.uniform(0.0, np.pi, n)
        self._waves = rng.standard_normal((n, WAVES, 2)) / CORRELATION
        self._phases = rng.uniform(0.0, 2.0 * np.pi, (n, WAVES))

    def truth(self, s, a):
        """Return pressures (n, n_tactels) Pa of presses at places (n,) m under the load, no noise."""
        x, y = s[:, None] - self.arm.tactel_s, a[:, None] - self.arm.tactel_a
        cos, sin = np.cos(self._angle), np.sin(self._angle)
        along, across = cos * x + sin * y, cos * y - sin * x
        stretched = np.hypot(along / np.sqrt(ELLIPSE), across * np.sqrt(ELLIPSE)) / self._width
        phase = np.einsum("ijk,jmk->ijm", np.stack([x, y], -1), self._waves) + self._phases
        residual = np.interp(np.hypot(x, y), RESIDUAL_AT, RESIDUAL) * np.cos(phase).sum(axis=-1)
        own = self._gain * np.interp(stretched, self._distances, self._law)
        return own + PEAK * np.sqrt(2.0 / WAVES) * residual + self._offset

    def read(self, s, a):
        """Return the same with the noise of the readings."""
        truth = self.truth(s, a)
        return truth + NOISE * self._rng.standard_normal(truth.shape)

    def presses(self, n, mislabelled):
        """Return presses all over the hull of the tactels as recorded, some of them elsewhere."""
        s, a = self.places(n)
        readings, wrong = self.read(s, a), self._rng.choice(n, mislabelled, replace=False)
        angle = self._rng.uniform(0.0, 2.0 * np.pi, len(wrong))
        s[wrong] += MISLABELLED_BY * np.cos(angle)
        a[wrong] += MISLABELLED_BY * np.sin(angle)
        return SimpleNamespace(s=s, a=a, readings=readings, mislabelled=wrong)

    def places(self, n):
        """Return random places (2, n) m within the hull of the tactels."""
        return np.array(
            [self._rng.uniform(x.min(), x.max(), n) for x in (self.arm.tactel_s, self.arm.tactel_a)]
        )
