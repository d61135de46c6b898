"""A board of rubber with gains that nobody measured, and the touches that happen to it.

``python -m tests.master.everyday_touches KIND N SEED`` touches it N times and prints gains and errors of
places before and after; kinds: fingers, same_place, too_strong, broken_neighbour.
"""

import sys

import numpy as np

from skinbus.estimate import Estimator
from skinbus.master.everyday_gains import EverydayGains
from skinbus.model import Arm, Transducer, grid
from skinbus.sim.laws import Elastic
from skinbus.study.skin_models import feel_of, shipped_law

NOISE = 150.0
SPREAD = 0.03
BROKEN = 14


class Touched:
    """Touches in, corrections of gains out."""

    def __init__(self, seed, n=6, pitch=0.008, radius=(0.006, 0.006)):
        self.rng = np.random.default_rng(seed)
        transducer = Transducer(full_scale=250e3, bits=16, converter_bits=12)
        self.arm = Arm.single_patch(grid(n, n, pitch), law=shipped_law(), transducer=transducer, noise=NOISE)
        count = self.arm.n_tactels
        self.gain = 1.0 + SPREAD * self.rng.standard_normal(count)
        self.gain /= self.gain.mean()
        self._transducer, self._half, self._radius = transducer, 0.5 * n * pitch, radius
        self._feels = {}
        self._estimator = Estimator(self.arm, "fit")
        self.everyday = EverydayGains(self.arm)
        self._t = 0

    def finger(self):
        """A place and force, and what a board with gains of 1 feels."""
        x = np.array([*self.rng.uniform(-self._half, self._half, 2), self.rng.uniform(3.0, 12.0)])
        return x, self.feel(x)

    def feel(self, x):
        radius = round(float(self.rng.uniform(*self._radius)), 4)
        if radius not in self._feels:
            self._feels[radius] = feel_of(self.arm, Elastic(), radius)
        return self._feels[radius](x[None])

    def read(self, felt):
        noisy = felt * self.gain + NOISE * self.rng.standard_normal(self.arm.n_tactels)
        return self._transducer.pressure(self._transducer.counts(noisy))

    def contacts(self, pressures):
        self._t += 1
        return self._estimator.update(pressures, self._t)

    def touch(self, felt):
        """One everyday touch."""
        pressures = self.read(felt)
        self.everyday.correct(pressures, np.zeros(self.arm.n_tactels))
        self.everyday.observe(self.contacts(pressures), pressures)

    def same_place(self):
        return self.feel(np.array([0.004, 0.006, 8.0]))

    def too_strong(self):
        return self.feel(np.array([*self.rng.uniform(-self._half, self._half, 2), 80.0]))

    def broken_neighbour(self):
        return self.broken(self.finger()[1])

    def fingers(self):
        return self.finger()[1]

    def broken(self, felt):
        """What is felt where a tactel has lost half of its gain."""
        felt = felt.copy()
        felt[BROKEN % len(felt)] *= 0.5
        return felt

    @property
    def spread(self):
        """What is left of the scatter of gains."""
        return float(np.std(self.gain * self.everyday.factor))

    def least_spread(self, n, radius=0.006, seen=100):
        """Standard deviation of gains that no method undercuts from n touches: van Trees' bound.

        Law and noise are exact; place, force and size of each tip are unknown. Of ``seen`` touches, weighed
        as n; the factor that a board has in common is left out.
        """
        count = self.arm.n_tactels
        information = np.eye(count) / SPREAD**2
        feel, wider = (feel_of(self.arm, Elastic(), r) for r in (radius, 1.05 * radius))
        for _ in range(seen):
            x = np.array([*self.rng.uniform(-self._half, self._half, 2), self.rng.uniform(3.0, 12.0)])
            p = feel(x[None])
            steps = [feel((x + step)[None]) for step in np.diag([1e-4, 1e-4, 1e-2])]
            q, _ = np.linalg.qr(np.stack([*steps, wider(x[None])], -1) - p[:, None])
            own = np.diag(p) - q @ (q * p[:, None]).T
            information += n / seen * own.T @ own / NOISE**2
        relative = np.eye(count) - 1.0 / count
        return float(np.sqrt(np.trace(relative @ np.linalg.inv(information)) / count))

    def errors(self, *, is_broken=False, n=200):
        """Errors of places (m), with the gains as they were and as learned, at the same n new touches."""
        off = []
        for _ in range(n):
            x, felt = self.finger()
            pressures = self.read(self.broken(felt) if is_broken else felt)
            learned = pressures.copy()
            self.everyday.correct(learned, np.zeros(len(learned)))
            pair = []
            for own in (pressures, learned):
                found = self.contacts(own)
                pair.append(np.hypot(found.s - x[0], found.a - x[1]).min(initial=1e-2))
            off.append(pair)
        return np.sqrt(np.mean(np.square(off), axis=0))


if __name__ == "__main__":
    kind, n_touches, first_seed = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    for shape in ((6, 0.008), (4, 0.010)):
        for sizes in ((0.006, 0.006), (0.002, 0.008)):
            board = Touched([first_seed, 0], *shape, radius=sizes)
            before = board.spread
            felt = [getattr(board, kind)() for _ in range(min(n_touches, 500))]
            for k in range(n_touches):
                board.touch(felt[k % len(felt)])
            least = board.least_spread(n_touches, max(sizes))
            was, now = 1e3 * board.errors(is_broken=kind == "broken_neighbour")
            own = board.everyday.boards[0]
            most = 100 * np.abs(own.factor - 1.0).max()
            print(
                f"{shape[0]} x {shape[0]}, tips of {1e3 * sizes[0]:g} to {1e3 * sizes[1]:g} mm: "
                f"gains {100 * before:.2f} -> {100 * board.spread:.2f} % "
                f"(no method below {100 * least:.2f} by fingers), most {most:.1f} %, "
                f"{own.watch.n_contacts} counted; places {was:.3f} -> {now:.3f} mm",
                flush=True,
            )
