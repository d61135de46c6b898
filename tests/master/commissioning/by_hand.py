"""Boards that are identified, located and calibrated without a bus, from presses whose places err by 0.3 mm.

``python -m tests.master.commissioning.by_hand 24 30 SEED`` prints the errors of contacts after each step, of
so many boards and presses on each; with ``--pictures docs/figures`` it draws those of docs/commissioning.md.
"""

import math
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from skinbus.config.system import load_arm
from skinbus.estimate import Estimator
from skinbus.estimate.location import PlacedPress, locate
from skinbus.estimate.presses.cross_validation import learn
from skinbus.estimate.presses.kinds import Press, tables_of
from skinbus.model import Arm
from tests.master.commissioning.afternoon import CORNERS, PLACE_SD, plan
from tests.master.commissioning.person import Hand, mounted

FORCE_N = 5.0
GAINS = 0.05
N_CYCLES = 4
"""Cycles of which the readings of a press are the mean."""


class ByHand:
    """Boards as they are mounted, and what is known of them."""

    def __init__(self, n, each, seed):
        with tempfile.TemporaryDirectory() as folder:
            self.planned = load_arm(plan(folder, n))
        self.true, _ = mounted(self.planned, seed, place_mm=1.7, n_mirrored=1)
        self.rng = np.random.default_rng([seed, 1])
        self.hand = Hand(self.true, seed)
        self.gain = 1.0 + GAINS * self.rng.standard_normal(self.true.n_tactels)
        self.surface = self.true.links[0].surface
        self.arm = self._identified()
        self.rows = self._pressed(each)

    def _identified(self):
        """Who sits where and turned by which quarter is found; the rest is as planned."""
        patches = []
        for own, wanted in zip(self.true.patches, self.planned.patches, strict=True):
            turn = math.remainder(own.yaw - wanted.yaw, math.tau)
            yaw = wanted.yaw + 0.5 * math.pi * round(turn / (0.5 * math.pi))
            patches.append(replace(own, s=wanted.s, a=wanted.a, yaw=yaw))
        return Arm(self.planned.name, self.planned.links, patches, *self.planned.buses)

    def read(self, s, a):
        """Pa that each tactel reads under a press, in one cycle."""
        self.hand.scene.plan.touches = [(0, float(s), float(a), FORCE_N)]
        return self.hand.pressures() * self.gain

    def _pressed(self, each):
        rows = []
        for p, placed in enumerate(self.arm.patches):
            anywhere = self.rng.uniform(-20e-3, 20e-3, (each - len(CORNERS), 2))
            for x, y in [*((17e-3 * x, 17e-3 * y) for x, y in CORNERS), *anywhere]:
                at = np.array([placed.s + x, y])
                s, a = self.surface.undevelop(*at, placed.a)
                readings = np.mean([self.read(s, a) for _ in range(N_CYCLES)], axis=0)
                told = self.surface.undevelop(*(at + PLACE_SD * self.rng.standard_normal(2)), placed.a)
                here = self.arm.tactels_of(p)
                rows.append(Press(p, float(told[0]), float(told[1]), FORCE_N, readings[here]))
        return rows

    def locate(self):
        """As `skinbus locate --write` does."""
        gain, patches = np.asarray(self.arm.tactel_gain), list(self.arm.patches)
        presses = [
            PlacedPress(row.patch, row.s, row.a, row.readings * gain[self.arm.tactels_of(row.patch)])
            for row in self.rows
        ]
        for board in locate(self.arm, presses).boards:
            placed = patches[board.patch]
            patches[board.patch] = replace(placed, s=board.s, a=board.a, yaw=board.yaw)
        self.arm = Arm(self.arm.name, self.arm.links, patches, *self.arm.buses)

    def calibrate(self):
        """As `skinbus calibrate` does; returns what is left of the scatter of gains."""
        ((table, _),) = tables_of(self.arm, self.rows)
        learned = learn(table, maps=False)
        noise = np.maximum(learned.noise, np.asarray(self.arm.tactel_noise))
        self.arm = replace(learned, noise=noise).apply(self.arm)
        return float(np.std(self.gain * learned.gain))

    def errors(self, n, seed=7):
        """Errors of places (m) of n contacts, the same ones each time, and how many were false."""
        rng, estimator = np.random.default_rng([seed, 2]), Estimator(self.arm, "fit")
        gain, off, n_false = np.asarray(self.arm.tactel_gain), [], 0
        for k in range(n):
            placed = self.true.patches[k % self.true.n_patches]
            x, y = rng.uniform(-17e-3, 17e-3, 2)
            s, a = self.surface.undevelop(placed.s + x, y, placed.a)
            found = estimator.update(self.read(s, a) * gain, k)
            far = np.asarray(self.surface.distance(s, a, found.s, found.a))
            off.append(far.min(initial=1.0))
            n_false += int((far > 10e-3).sum())
        return np.array(off), n_false


def steps(n, each, seed, n_contacts):
    """Return the boards and the errors after each step."""
    day, errors = ByHand(n, each, seed), {}
    errors["identified"] = day.errors(n_contacts)
    day.locate()
    errors["located"] = day.errors(n_contacts)
    left = day.calibrate()
    day.locate()
    errors["calibrated"] = day.errors(n_contacts)
    return day, errors, left


def rms(off):
    """Root mean square of errors, m."""
    return float(np.sqrt(np.mean(np.square(off))))


def draw(day, errors, folder):
    """Draw the boards on the unrolled link, and the errors after each step."""
    from skinbus.study.draw import new_figure, save

    figure, axes = new_figure(width=7.0, height=3.6)
    axis = axes[0, 0]
    for arm, style, name in (
        (day.planned, {"color": "0.4", "linestyle": ":"}, "as planned"),
        (day.true, {"color": "0.7", "linewidth": 3.0}, "as mounted"),
        (day.arm, {"color": "tab:blue", "linewidth": 0.9}, "as located"),
    ):
        for k, (placed, wanted) in enumerate(zip(arm.patches, day.planned.patches, strict=True)):
            u, v = 0.5 * np.array(placed.patch.size)
            x, y = np.array([[u, v], [-u, v], [-u, -v], [u, -v], [u, v]]).T
            cos, sin = np.cos(placed.yaw), np.sin(placed.yaw)
            # a board at the line where the link is unrolled is drawn on the side where it was planned
            a = wanted.a + day.surface.wrap(placed.a - wanted.a)
            axis.plot(
                1e3 * (a + sin * x + cos * y),
                1e3 * (placed.s + cos * x - sin * y),
                label=name if not k else None,
                **style,
            )
    on_first = [row for row in day.rows if row.patch == 0]
    at = 1e3 * np.array([(row.a, row.s) for row in on_first]).T
    axis.plot(*at, ".", color="tab:orange", ms=4, label="pressed")
    axis.set(xlabel="a, mm", ylabel="s, mm", aspect="equal")
    figure.legend(loc="outside lower center", ncols=4)
    save(figure, folder, "commissioning-boards")
    figure, axes = new_figure(width=6.0, height=4.0)
    axis = axes[0, 0]
    for (name, (off, _)), colour in zip(errors.items(), ("tab:orange", "tab:green", "tab:blue"), strict=True):
        label = f"{name}: median {1e3 * np.median(off):.2f} mm, RMS {1e3 * rms(off):.2f} mm"
        axis.plot(1e3 * np.sort(off), np.linspace(0.0, 100.0, len(off)), color=colour, label=label)
    axis.set(xscale="log", xlabel="error of a contact, mm", ylabel="contacts, %")
    figure.legend(loc="outside lower center")
    save(figure, folder, "commissioning-errors")


if __name__ == "__main__":
    n_boards, n_each, first_seed = map(int, sys.argv[1:4])
    done, after, scatter = steps(n_boards, n_each, first_seed, 20 * n_boards)
    for step, (own, false) in after.items():
        print(
            f"{step}: median {1e3 * np.median(own):.3f} mm, RMS {1e3 * rms(own):.3f}, "
            f"at most {1e3 * own.max():.2f}; {false} false"
        )
    print(f"gains {100 * GAINS:.1f} -> {100 * scatter:.1f} %")
    if "--pictures" in sys.argv:
        draw(done, after, Path(sys.argv[sys.argv.index("--pictures") + 1]))
