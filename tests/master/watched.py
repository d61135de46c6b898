"""A board under the eyes of its health, without a bus: readings in, cycles of a second."""

from types import SimpleNamespace

import numpy as np

from skinbus.config.system import load_arm
from skinbus.estimate import Baseline, Estimator, Plausibility, Tracker
from skinbus.master.health import SETTLED, Health

NS = 1_000_000_000


class Watched:
    """A pad whose readings a test makes."""

    def __init__(self, seed, arm=None, tables=None):
        self.arm = arm or load_arm("pad")
        self.rng = np.random.default_rng(seed)
        self.cycle = SimpleNamespace(
            serials=np.zeros(1, np.int64),
            arm=self.arm,
            baseline=Baseline(self.arm),
            plausibility=Plausibility(self.arm),
            tracker=Tracker(self.arm),
        )
        self.estimator = Estimator(self.arm, level="fit")
        self.health = Health(self.cycle)
        if tables:
            self.health.resume(tables)
        n = self.arm.n_tactels
        self.zero, self.noise, self.gain = np.zeros(n), np.full(n, 200.0), np.ones(n)
        self.t_ns = NS
        self.fresh = np.ones(self.arm.n_patches, np.bool_)

    def run(self, seconds, *touch, each=lambda: None):
        """Let cycles pass, under a contact (s, a, N) if one is given."""
        for _ in range(seconds):
            each()
            self.t_ns += NS
            pressures = self.zero + self.noise * self.rng.standard_normal(self.arm.n_tactels)
            if touch:
                s, a, force = touch
                d = self.arm.distance(slice(None), s, a)
                pressures += self.gain * self.arm.patches[0].patch.law.pressure(d, force)
            cycle = self.cycle
            cycle.plausibility.judge(pressures, self.t_ns, self.fresh, cycle.baseline)
            cycle.baseline.apply(pressures, self.t_ns, self.fresh)
            contacts = self.estimator.update(pressures, self.t_ns, baseline=cycle.baseline)
            self.health.observe(
                SimpleNamespace(
                    t_ns=self.t_ns, contacts=contacts, fresh=self.fresh, pressures=np.nan_to_num(pressures)
                )
            )

    def settle(self):
        """Let the board be commissioned, with zeros of 600 Pa."""
        self.zero[:] = 600.0
        self.run(10 * SETTLED + 30)

    def tables(self):
        """What is kept."""
        return self.health.as_tables(self.health.records)
