"""Readings of a forearm with noise and the steps of its converters, and who judges them."""

from dataclasses import replace

import numpy as np

from skinbus.config.system import load_arm
from skinbus.estimate import Baseline, Plausibility
from skinbus.model import Arm

ARM = load_arm("forearm", check_load=False)
N = ARM.n_tactels
PATCH = 5
BOARD = ARM.tactels_of(PATCH)
CORNER, EDGE, INNER = BOARD.start, BOARD.start + 1, BOARD.start + 5
APART = np.array([1, 3, 5, 7, 17, 19, 21, 23])
"""Boards with another one between them: what happens on one is not felt on the others."""
PERIOD_NS = 20_000_000
TRANSDUCER = ARM.patches[0].patch.transducer
TOP = TRANSDUCER.top_counts * TRANSDUCER.step
LAW = ARM.patches[0].patch.law
NO_TOUCH = np.zeros(N)


class Skin:
    """Readings of a forearm with noise and the steps of its converters, and who judges them.

    ``mend`` changes the readings (Pa, in place) of each cycle, as a fault does.
    """

    def __init__(self, seed, mend=lambda raw, cycle, rng: None, arm=ARM):
        self.rng = np.random.default_rng(seed)
        self.transducer = arm.patches[0].patch.transducer
        self.baseline, self.plausibility = Baseline(arm), Plausibility(arm)
        self.zeros = 100.0 * self.rng.standard_normal(N)
        self.fresh = np.ones(ARM.n_patches, np.bool_)
        self.mend = mend
        self.cycle = 0

    def read(self, pressures=NO_TOUCH, cycles=1):
        """Judge some cycles; return the readings of the last, as the baseline leaves them."""
        for _ in range(cycles):
            raw = pressures + self.zeros + ARM.tactel_noise * self.rng.standard_normal(N)
            step = self.transducer.resolution
            raw = np.minimum(np.rint(raw / step) * step, self.transducer.top_counts * self.transducer.step)
            self.mend(raw, self.cycle, self.rng)
            self.cycle += 1
            t_ns = self.cycle * PERIOD_NS
            self.plausibility.judge(raw, t_ns, self.fresh, self.baseline)
            self.baseline.apply(raw, t_ns, self.fresh)
        return raw

    def cycles_to(self, fault, tactels, pressures=NO_TOUCH, most=1000):
        """Return after how many cycles all these tactels have a fault."""
        for n in range(most):
            self.read(pressures)
            if (self.plausibility.faults[tactels] & fault).all():
                return n + 1
        raise AssertionError(f"{fault!r} not named in {most} cycles")

    @property
    def faulty(self):
        return np.flatnonzero(self.plausibility.faults).tolist()


def coarse_arm(bits):
    """Return the forearm with converters of so few bits."""
    transducer = replace(TRANSDUCER, converter_bits=bits)
    patches = [replace(p, patch=replace(p.patch, transducer=transducer)) for p in ARM.patches]
    return Arm("coarse", ARM.links, patches, *ARM.buses)


def press(s, a, force):
    """Pa on every tactel of a contact by the law of the boards."""
    return LAW.pressure(ARM.distance(slice(None), s, a), force)


def press_at(tactel, rng, within):
    """Pa of a contact of 2 to 30 N within so many metres of a tactel."""
    r, angle = within * np.sqrt(rng.random()), 2.0 * np.pi * rng.random()
    s, a = ARM.tactel_s[tactel] + r * np.cos(angle), ARM.tactel_a[tactel] + r * np.sin(angle)
    return press(s, a, 10.0 ** rng.uniform(0.3, 1.5))
