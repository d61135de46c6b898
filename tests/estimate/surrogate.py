"""Surrogates of a measured array: eight barometers under rubber, with the scatter that such arrays show.

The figures are those of recordings of real arrays: a law of 6.5 mm full width at half maximum; the responses
of tactels differ as the effect ``response`` of scenes says, offsets by 0.2 % of the peak; one press in 500 is
recorded 5 mm away from where it was. The load is constant and unknown, as with a weight on a guided tip.
"""

from types import SimpleNamespace

import numpy as np

from skinbus.model import Arm, Transducer
from skinbus.model.patch import grid
from skinbus.sim.bonded_layer import profile
from skinbus.sim.effects.mounting import Response
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.laws import Elastic
from skinbus.sim.layer import Geometry, Loads

TIP = 0.001
"""m, radius of the tip and of the port of a tactel."""
LAYER = Elastic(thickness_mm=6.2)
"""With a tip of 2 mm and tactels of 2 mm, a full width at half maximum of 6.5 mm."""
PEAK = 20e3
"""Pa under the load of the presses; the load itself is not given."""
NOISE = 0.001 * PEAK
"""Pa: a barometer's own noise after averaging."""
MISLABELLED_BY = 0.005
"""m"""


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
        self._rng, geometry = rng, Geometry.of(self.arm, discs=LAYER.discs)
        Response().bind(self.arm, rng)(geometry)
        self._law = LAYER.bind(geometry, [Indenter(Shape.DISC, 2.0 * TIP)])
        lengths = {"thickness": 1e-3 * LAYER.thickness_mm, "tactel_radius": TIP, "indenter_radius": TIP}
        self._load = PEAK / profile(np.zeros(1), poisson=LAYER.poisson, **lengths)[0]
        self._offset = 0.002 * PEAK * rng.standard_normal(self.arm.n_tactels)

    def truth(self, s, a):
        """Return pressures (n, n_tactels) Pa of presses at places (n,) m under the load, no noise."""
        found = np.tile(self._offset, (len(s), 1))
        for row, place in zip(found, np.column_stack([s, a]), strict=True):
            self._law.add(Loads(1, s=place[0], a=place[1], force=self._load), row)
        return found

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
