"""Presses of discs and bars over the outermost tactels of boards, and what is sure of them without reason.

The layer is elastic, of another thickness than that of the law that ships, and every tactel has a gain that
nobody has measured. `python -m tests.estimate.rim_presses [SEED [CASES]]` prints a line per law, indenter and
band of distances beyond the outermost tactels; `sure` are contacts further from the truth than 3 and 6 of
their own standard deviations and without a flag.
"""

import sys
from dataclasses import dataclass, field

import numpy as np

from skinbus.estimate import Estimator, learn_radial_law
from skinbus.master.cycle import FORCE_SHARE, GAIN_SHARE, SHIFT_M, TIP_SHARE
from skinbus.model import Arm, Link, PlacedPatch, Surface
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.laws import Elastic
from skinbus.sim.layer import Geometry, Loads

GAINS = 0.03
BARE = 0.020
"""m of bare skin around the boards."""
FORCES = (2.0, 20.0)
THICKNESSES_MM = (5.5, 6.5)
BANDS_MM = (-4.0, 0.0, 4.0, 8.0, 12.0)
"""Beyond the outermost row of tactels; nearer in counts as inside."""
CALIBRATED_WITH = Indenter(Shape.DISC, 0.012)


def make_arm(eds="skin-patch", boards=(1, 1), gap=0.001):
    """Return boards side by side on a plane with bare skin around."""
    patch = describe_patch(load_eds(eds, 1))
    width, height = patch.size
    size = (boards[0] * (width + gap) + 2.0 * BARE, boards[1] * (height + gap) + 2.0 * BARE)
    link = Link("plate", Surface.plane(*size))
    placed = [
        PlacedPatch(
            patch=patch,
            node_id=1 + i * boards[1] + j,
            link=0,
            s=BARE + (i + 0.5) * (width + gap),
            a=(j - 0.5 * (boards[1] - 1)) * (height + gap),
        )
        for i in range(boards[0])
        for j in range(boards[1])
    ]
    return Arm("plate", [link], placed)


class Layer:
    """What the tactels of an arm feel of one indenter through one layer."""

    def __init__(self, arm, indenter, thickness_mm):
        self.arm, self.indenter = arm, indenter
        self._law = Elastic(thickness_mm=thickness_mm).bind(Geometry.of(arm, discs=True), [indenter])
        self._touched = np.zeros(arm.n_patches, np.bool_)

    def feel(self, s, a, force, yaw=0.0):
        """Return (n_tactels,) Pa."""
        loads = Loads(1)
        loads.n = 1
        loads.s[:], loads.a[:], loads.force[:], loads.yaw[:] = s, a, force, yaw
        loads.radius[:] = 0.5 * self.indenter.length
        clean = np.zeros(self.arm.n_tactels)
        self._law.add(loads, clean, self._touched)
        return clean


def calibrate(arm, thickness_mm, gains, rng, presses=200):
    """Return the arm with the law of 200 presses of a finger on it, and the gains for its readings."""
    layer = Layer(arm, CALIBRATED_WITH, thickness_mm)
    noise = arm.tactel_noise
    s = rng.uniform(arm.tactel_s.min() - 0.005, arm.tactel_s.max() + 0.005, presses)
    a = rng.uniform(arm.tactel_a.min() - 0.005, arm.tactel_a.max() + 0.005, presses)
    force = rng.uniform(2.0, 20.0, presses)
    readings = np.stack(
        [
            layer.feel(*press) * gains + noise * rng.standard_normal(arm.n_tactels)
            for press in zip(s, a, force, strict=True)
        ]
    )
    learned = learn_radial_law(arm, s, a, force, readings)
    return learned.apply(arm), np.broadcast_to(learned.gain, arm.n_tactels)


@dataclass
class Tally:
    """Contacts of one band of distances."""

    presses: int = 0
    silent: int = 0
    contacts: int = 0
    flagged: int = 0
    place: list = field(default_factory=list)
    """Distances from the truth in standard deviations, of contacts without a flag."""
    force: list = field(default_factory=list)
    ratio: list = field(default_factory=list)
    off_mm: list = field(default_factory=list)
    sd_mm: list = field(default_factory=list)
    sd_force: list = field(default_factory=list)

    def beyond(self, n_sd):
        """Return how many contacts without a flag are further from the truth in place or force."""
        return sum(value > n_sd for value in self.place + self.force)

    def line(self):
        place, force = np.array(self.place), np.array(self.force)
        n = max(len(place), 1)
        if not len(place):
            return f"presses {self.presses} silent {self.silent} flagged {self.flagged}"
        return (
            f"presses {self.presses:4d} silent {self.silent:3d}"
            f" contacts {self.contacts:4d} flagged {self.flagged:4d}"
            f" sure: place>3 {np.sum(place > 3) / n:6.3f} >6 {np.sum(place > 6) / n:6.3f}"
            f" force>3 {np.sum(force > 3) / n:6.3f} >6 {np.sum(force > 6) / n:6.3f}"
            f" | median off {np.median(self.off_mm):5.2f} mm sd {np.median(self.sd_mm):5.2f}"
            f" F/F {np.median(self.ratio):5.2f} sd {np.median(self.sd_force):5.2f}"
        )


def published(contacts, j, is_measured):
    """Return the covariance of contact j with what the master adds to it, (3, 3)."""
    share = TIP_SHARE if is_measured else GAIN_SHARE
    if not is_measured and contacts.width_sd[j] == 0.0:
        share = float(np.hypot(share, FORCE_SHARE))
    added = np.diag([SHIFT_M**2, SHIFT_M**2, (share * contacts.force[j]) ** 2])
    return contacts.covariance[j] + added


def compare(tally, contacts, press, indenter, is_measured):
    """Add the contacts of one press.

    Where there are several, each may be anywhere on the middle line of a bar, and has no force of its own.
    """
    s, a, force, yaw = press
    tally.presses += 1
    tally.silent += len(contacts) == 0
    for j in range(len(contacts)):
        tally.contacts += 1
        if contacts.quality[j]:
            tally.flagged += 1
            continue
        off = np.array([contacts.s[j] - s, contacts.a[j] - a])
        if len(contacts) > 1:
            way = np.array([np.cos(yaw), np.sin(yaw)])
            half = 0.5 * max(indenter.length - (indenter.width or indenter.length), 0.0)
            off -= np.clip(off @ way, -half, half) * way
        cov = published(contacts, j, is_measured)
        tally.place.append(float(np.sqrt(off @ np.linalg.solve(cov[:2, :2], off))))
        if len(contacts) == 1:
            tally.force.append(float(abs(contacts.force[j] - force) / np.sqrt(cov[2, 2])))
            tally.ratio.append(float(contacts.force[j] / force))
        tally.off_mm.append(1e3 * float(np.hypot(*off)))
        tally.sd_mm.append(1e3 * float(np.sqrt(np.trace(cov[:2, :2]))))
        tally.sd_force.append(float(np.sqrt(cov[2, 2])) / force)


def beyond(arm, s, a):
    """Return how far (m) a place is outside the hull of a plate's tactels; negative inside."""
    return max(arm.tactel_s.min() - s, s - arm.tactel_s.max(), arm.tactel_a.min() - a, a - arm.tactel_a.max())


class RimPresses:
    """Presses of one indenter at random places from inside a board to 12 mm beyond its outermost tactels."""

    def __init__(self, indenter, *, law="shipped", eds="skin-patch", boards=(1, 1), seed=0):
        self.rng = np.random.default_rng([seed, round(1e6 * indenter.length)])
        self.arm = make_arm(eds, boards)
        self.indenter = indenter
        self.skins = []
        for thickness in THICKNESSES_MM:
            response = 1.0 + GAINS * self.rng.standard_normal(self.arm.n_tactels)
            arm, gain = self.arm, np.ones(self.arm.n_tactels)
            if law == "calibrated":
                arm, gain = calibrate(self.arm, thickness, response, self.rng)
            self.skins.append((arm, Layer(self.arm, indenter, thickness), response * gain))

    def draw(self, least=-0.008, most=0.012):
        """Return s, a (m), force (N), yaw of a press so far outside the hull of all tactels."""
        arm, rng = self.arm, self.rng
        while True:
            s = rng.uniform(arm.tactel_s.min() - most, arm.tactel_s.max() + most)
            a = rng.uniform(arm.tactel_a.min() - most, arm.tactel_a.max() + most)
            if least <= beyond(arm, s, a) <= most:
                return s, a, float(np.exp(rng.uniform(*np.log(FORCES)))), rng.uniform(0.0, np.pi)

    def measure(self, level, n, most=0.012):
        """Return tallies by band of n presses up to ``most`` (m) outside the hull."""
        tallies = [Tally() for _ in range(len(BANDS_MM) + 1)]
        estimators = [Estimator(arm, level) for arm, _, _ in self.skins]
        for k in range(n):
            arm, layer, response = self.skins[k % len(self.skins)]
            press = self.draw(most=most)
            p = layer.feel(*press) * response + arm.tactel_noise * self.rng.standard_normal(arm.n_tactels)
            contacts = estimators[k % len(self.skins)].update(p, k)
            band = int(np.searchsorted(BANDS_MM, 1e3 * beyond(arm, press[0], press[1])))
            compare(tallies[band], contacts, press, self.indenter, arm is not self.arm)
        return tallies


DISCS = {"finger 12": Indenter(Shape.DISC, 0.012), "finger 16": Indenter(Shape.DISC, 0.016)}
BARS = {"bar 15x8": Indenter(Shape.PALM, 0.015, 0.008), "bar 25x10": Indenter(Shape.PALM, 0.025, 0.010)}


def main():
    seed = int(sys.argv[1]) if len(sys.argv) > 1 else 17
    n = int(sys.argv[2]) if len(sys.argv) > 2 else 400
    which = sys.argv[3:] or ["shipped", "calibrated"]
    for law in which:
        for name, indenter in (DISCS | BARS).items():
            for boards in ((1, 1),) if name in DISCS else ((1, 1), (2, 2)):
                presses = RimPresses(indenter, law=law, boards=boards, seed=seed)
                for level in ("fit", "full"):
                    for band, tally in zip((*BANDS_MM, 99.0), presses.measure(level, n), strict=True):
                        if tally.presses:
                            skin = f"{law} {name} {boards[0]}x{boards[1]} {level:4s}"
                            print(f"{skin} to {band:4g} mm  {tally.line()}", flush=True)


if __name__ == "__main__":
    main()
