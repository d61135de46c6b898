"""False alarms of a healthy forearm, pressed by the physics of the simulator, with indenters of which its law
knows nothing. The baseline and the judgement of tactels are driven, with noise, gains that differ and the
steps of the converters; no master.
"""

import numpy as np

from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.laws import Elastic
from skinbus.sim.layer import Geometry, Loads
from tests.estimate.judged_skin import ARM, NO_TOUCH, N, Skin

DISCS_M = (0.002, 0.004, 0.006, 0.010, 0.015, 0.025)
INDENTERS = [Indenter(Shape.DISC, diameter) for diameter in DISCS_M]
INDENTERS += [Indenter(Shape.PALM, 0.080, 0.060), Indenter(Shape.PALM, 0.040, 0.004)]
GAIN_SD = 0.08
"""Of the gains of tactels: those of real arrays differ by 6 to 11 %."""
MOST = 3
PERIODS = np.array([10, 150])
"""Of a touch, in cycles, the least and the most."""


class Touches:
    """One touch of one to three indenters after the other, each of which moves and changes its force."""

    def __init__(self, rng):
        self.rng = rng
        self.gain = 1.0 + GAIN_SD * rng.standard_normal(N)
        self._law = Elastic().bind(Geometry.of(ARM, discs=True), INDENTERS)

    def touch(self):
        """Yield (n_tactels,) Pa, cycle by cycle, of a touch within 20 mm of random tactels."""
        rng = self.rng
        n, cycles = rng.integers(1, MOST + 1), rng.integers(*PERIODS)
        i = rng.integers(N, size=n)
        r, angle = 0.02 * np.sqrt(rng.random(n)), 2.0 * np.pi * rng.random(n)
        kind = rng.integers(len(INDENTERS), size=n)
        there = rng.uniform(-0.01, 0.01, (2, n))
        force = 10.0 ** rng.uniform(-0.3, 1.5, (2, n))
        loads = Loads(
            n,
            link=ARM.tactel_link[i],
            indenter=kind,
            radius=[0.5 * INDENTERS[k].length for k in kind],
            yaw=rng.uniform(0.0, np.pi, n),
        )
        s, a = ARM.tactel_s[i] + r * np.cos(angle), ARM.tactel_a[i] + r * np.sin(angle)
        for t in (np.arange(cycles) + 0.5) / cycles:
            loads.s[:], loads.a[:] = s + t * there[0], a + t * there[1]
            rises = min(5.0 * t, 1.0, 5.0 * (1.0 - t))
            loads.force[:] = rises * ((1.0 - t) * force[0] + t * force[1])
            clean = np.zeros(N)
            self._law.add(loads, clean)
            yield self.gain * clean


def alarms(skin):
    """Faults that are named, and boards withheld."""
    judged = skin.plausibility
    return bool(judged.n_faulty.any() or judged.is_withheld.any())


def touched(seed, cycles, arm=ARM):
    """Return how many cycles of touches have a false alarm, and how many readings were missing in them."""
    skin = Skin(seed, arm=arm)
    touches = Touches(skin.rng)
    skin.read(cycles=60)
    n = n_missing = done = 0
    while done < cycles:
        for pressures in touches.touch():
            readings = skin.read(pressures)
            n += alarms(skin)
            n_missing += int(np.isnan(readings).sum())
            done += 1
        for _ in range(skin.rng.integers(5, 30)):
            skin.read(NO_TOUCH)
            n += alarms(skin)
    return n, n_missing, done
