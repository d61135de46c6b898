"""How true contacts are where the law is not: hard cases, the cone and the law that ships.

`python -m tests.study.truth_table [SEED [CASES [NAME ...]]]`; NAME is the beginning of the name of a case.
"""

import sys
import time

import numpy as np
from scipy.optimize import linear_sum_assignment

from skinbus.estimate import Estimator
from skinbus.model import Arm, Cone, Radial, Transducer
from skinbus.model.patch import grid
from skinbus.sim.laws import Elastic
from skinbus.study.skin_models import NOISE, cone_forearm, feel_of, shipped_law

GAINS = 0.03
INSIDE = 0.015
FAR = 6.0
"""Standard deviations in one coordinate at which an answer is a lie."""


class Tally:
    """Errors of contacts, NEES, counts of a case."""

    def __init__(self):
        self.n = self.right = self.more = self.fewer = self.lies = 0
        self.place, self.force, self.nees, self.total = [], [], [], []

    def add(self, arm, touches, contacts):
        self.n += 1
        k, found = len(touches), len(contacts)
        self.right += found == k
        self.more += found > k
        self.fewer += found < k
        if not found:
            return
        self.total.append(contacts.force.sum() / touches[:, 2].sum() - 1.0)
        if found != k:
            return
        surface = arm.links[0].surface
        d = surface.distance(touches[:, :1], touches[:, 1:2], contacts.s, contacts.a)
        worst = 0.0
        for i, c in zip(*linear_sum_assignment(d), strict=True):
            error = np.array(
                [
                    contacts.s[c] - touches[i, 0],
                    float(surface.wrap(contacts.a[c] - touches[i, 1])),
                    contacts.force[c] - touches[i, 2],
                ]
            )
            covariance = contacts.covariance[c]
            self.place.append(1e3 * d[i, c])
            self.force.append(error[2] / touches[i, 2])
            self.nees.append(error @ np.linalg.solve(covariance, error) / 3.0)
            worst = max(worst, float(np.max(np.abs(error) / np.sqrt(np.diag(covariance)))))
        self.lies += worst > FAR

    def __str__(self):
        rms = lambda x: float(np.sqrt(np.mean(np.square(x)))) if len(x) else np.nan  # noqa: E731
        nees = np.array(self.nees) if self.nees else np.array([np.nan])
        off = np.abs(self.total) > 0.1 if self.total else np.zeros(1)
        return (
            f"right {100 * self.right / self.n:5.1f} % (+{self.more} -{self.fewer})  "
            f"place {rms(self.place):6.3f} mm  force {100 * rms(self.force):6.1f} %  "
            f"NEES {nees.mean():8.2f} median {np.median(nees):5.2f} >10 {100 * np.mean(nees > 10):4.1f} %  "
            f"> {FAR:g} sd {self.lies}  total off {100 * np.mean(off):4.1f} %"
        )


def pressed(arm, rng, touches, indenter=0.006, gains=GAINS):
    """Pressures of an elastic layer of 6 mm under discs, gains that the estimator is not told."""
    feel = feel_of(arm, Elastic(), indenter)
    gain = 1.0 + gains * rng.standard_normal(arm.n_tactels)
    return feel(touches) * gain + NOISE * rng.standard_normal(arm.n_tactels)


def by_law(arm, rng, touches):
    """Pressures of the arm's own law."""
    law = arm.patches[0].patch.law
    d = arm.links[0].surface.distance(arm.tactel_s, arm.tactel_a, touches[:, :1], touches[:, 1:2])
    clean = sum(law.pressure(d[i], touches[i, 2]) for i in range(len(touches)))
    return clean + NOISE * rng.standard_normal(arm.n_tactels)


def apart(rng, k, half, least, force):
    """k touches (k, 3) in a square, that far apart."""
    while True:
        places = []
        for _ in range(400):
            place = rng.uniform(-half, half, 2)
            if all(np.hypot(*(place - other)) >= least for other in places):
                places.append(place)
            if len(places) == k:
                return np.column_stack([places, force(rng, k)])


def even(low, high):
    return lambda rng, k: rng.uniform(low, high, k)


def pad(pitch=0.010, n=4, law=None, **settings):
    return Arm.single_patch(grid(n, n, pitch), law=shipped_law() if law is None else law, **settings)


def pair(rng, least, most, forces):
    while True:
        angle, d = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(least, most)
        step = 0.5 * d * np.array([np.cos(angle), np.sin(angle)])
        middle = rng.uniform(-INSIDE, INSIDE, 2)
        if np.abs([middle - step, middle + step]).max() <= INSIDE:
            return np.column_stack([[middle - step, middle + step], forces])


def case(arm, level, draw, read, n, seed):
    """The tally of n cases."""
    rng, estimator, tally = np.random.default_rng(seed), Estimator(arm, level), Tally()
    for i in range(n):
        touches = draw(rng)
        tally.add(arm, touches, estimator.update(read(arm, rng, touches), i))
    return tally


def narrow_law(sd):
    d = np.linspace(0.0, 4.5 * sd, 64)
    return Radial(d[1], np.exp(-0.5 * (d / sd) ** 2) / (2.0 * np.pi * sd**2))


def cases():
    """Name: (arm, level, draw, read, part of the cases)."""
    box, forearm = pad(), cone_forearm().with_law(shipped_law())
    one = lambda rng: apart(rng, 1, INSIDE, 0.0, even(2.0, 20.0))  # noqa: E731
    found = {}
    for mm in (2, 4, 8, 12, 18, 25):
        by = lambda arm, rng, t, r=mm / 2000: pressed(arm, rng, t, r)  # noqa: E731
        for level in ("fit", "full"):
            found[f"size {mm} mm {level}"] = box, level, one, by, 1.0
    for low, high in ((8, 15), (15, 20), (20, 25)):
        draw = lambda rng, a=low, b=high: pair(rng, a * 1e-3, b * 1e-3, (5.0, 5.0))  # noqa: E731
        found[f"pair of fingers {low}-{high} mm full"] = box, "full", draw, pressed, 1.0
        found[f"pair of tips {low}-{high} mm full"] = (
            *(box, "full", draw),
            lambda arm, rng, t: pressed(arm, rng, t, 0.001),
            1.0,
        )
    for mm in (10, 15):
        draw = lambda rng, d=mm * 1e-3: pair(rng, d, d, (10.0, 1.0))  # noqa: E731
        found[f"10:1 pair {mm} mm full radial"] = box, "full", draw, by_law, 1.0
        found[f"10:1 pair {mm} mm full elastic"] = box, "full", draw, pressed, 1.0
    full_scale = pad(transducer=Transducer(full_scale=40e3))
    strong = lambda rng: apart(rng, 1, INSIDE, 0.0, even(10.0, 40.0))  # noqa: E731
    for level in ("fit", "full"):
        found[f"saturated radial {level}"] = full_scale, level, strong, by_law, 2.0
        found[f"saturated elastic {level}"] = full_scale, level, strong, pressed, 2.0
        found[f"far rivals cone {level}"] = pad(law=Cone()), level, one, by_law, 6.0
        found[f"far rivals radial 4 mm {level}"] = pad(law=narrow_law(0.004)), level, one, by_law, 6.0
        found[f"narrow radial 3 mm {level}"] = pad(0.008, law=narrow_law(0.003)), level, one, by_law, 1.0
    dense = {"cone": pad(0.0065, 8, Cone()), "ships": pad(0.0065, 8)}
    for k in (4, 6, 9):
        draw = lambda rng, k=k: apart(rng, k, 3.5 * 0.0065, 0.013, even(2.0, 8.0))  # noqa: E731
        for name, arm in dense.items():
            found[f"many K={k} {name} full"] = arm, "full", draw, by_law, 0.15
        found[f"many K={k} elastic full"] = dense["ships"], "full", draw, pressed, 0.15
    small = {"cone": pad(n=3, law=Cone()), "ships": pad(n=3)}
    two = lambda rng: apart(rng, 2, 0.010, 0.010, even(4.0, 8.0))  # noqa: E731
    for name, arm in small.items():
        found[f"3x3 two {name} full"] = arm, "full", two, by_law, 1.0
    surface = forearm.links[0].surface

    def five(rng):
        while True:
            s, a = rng.uniform(0.010, surface.length - 0.010, 5), rng.uniform(-0.19, 0.19, 5)
            d = surface.distance(s[:, None], a[:, None], s, a)
            if d[np.triu_indices(5, 1)].min() >= 0.025:
                return np.column_stack([s, a, rng.uniform(3.0, 12.0, 5)])

    for level in ("fit", "full"):
        found[f"forearm five {level}"] = forearm, level, five, pressed, 0.3
    return found


def held_finger(level, drift, seed):
    """Largest relative change of force, and cycles without exactly one contact, while all boards drift."""
    arm, rng = pad(), np.random.default_rng(seed)
    estimator, forces, wrong = Estimator(arm, level), [], 0
    for k in range(200):
        touch = np.array([[0.002, -0.003, 8.0]])
        found = estimator.update(by_law(arm, rng, touch) + drift * k / 199, k)
        wrong += len(found) != 1
        forces.append(found.force.sum())
    return abs(np.mean(forces[-30:]) / np.mean(forces[:30]) - 1.0), wrong


def idle(level, offset, boards, n, seed):
    """Cycles of n with a contact, nothing touched, an offset (Pa) on one board or all of a forearm."""
    arm, rng = cone_forearm().with_law(shipped_law()), np.random.default_rng(seed)
    shift = np.where((arm.tactel_patch == 5) | (boards == "all"), offset, 0.0)
    estimator, found = Estimator(arm, level), 0
    for k in range(n):
        found += len(estimator.update(shift + NOISE * rng.standard_normal(arm.n_tactels), k)) > 0
    return found


def speed(seed):
    """Print us per contact and patch, law that ships, one contact on each of n boards, and a forearm."""
    rng = np.random.default_rng(seed)
    whole = cone_forearm(rings=16)
    for name, law in (("cone", Cone()), ("ships", shipped_law())):
        arm = Arm("126", whole.links, whole.patches[:126]).with_law(law)
        places = np.column_stack([arm.patch_s, arm.patch_a]) + rng.uniform(-0.01, 0.01, (126, 2))
        for level in ("fit", "full"):
            estimator, row = Estimator(arm, level), []
            for n in (1, 5, 20, 60, 126):
                p = by_law(arm, rng, np.column_stack([places[:n], np.full(n, 5.0)]))
                times = []
                for k in range(30):
                    begin = time.thread_time_ns()
                    estimator.update(p, k)
                    times.append((time.thread_time_ns() - begin) / 1e3 / n)
                row.append(f"{n}: {np.median(times):.1f}")
            print(f"time {name} {level}, us per contact, {'  '.join(row)}", flush=True)
    arm, _, draw, read, _ = cases()["forearm five full"]
    films = [read(arm, rng, draw(rng)) for _ in range(60)]
    for level in ("fit", "full"):
        estimator, times = Estimator(arm, level), []
        for k, p in enumerate(films * 4):
            begin = time.thread_time_ns()
            estimator.update(p, k)
            times.append((time.thread_time_ns() - begin) / 1e3)
        p50, p99 = np.percentile(times, [50, 99])
        print(f"time forearm five {level}: p50 {p50:.0f} p99 {p99:.0f} max {max(times):.0f} us", flush=True)


def main():
    seed = int(sys.argv[1]) if len(sys.argv) > 1 else 7000
    n = int(sys.argv[2]) if len(sys.argv) > 2 else 200
    names = sys.argv[3:] or [""]
    wanted = lambda name: any(name.startswith(start) for start in names)  # noqa: E731
    for name, (arm, level, draw, read, part) in cases().items():
        if wanted(name):
            print(f"{name:36s} {case(arm, level, draw, read, max(int(part * n), 10), seed)}", flush=True)
    for level in ("fit", "full"):
        if wanted("held"):
            change, wrong = held_finger(level, 100.0, seed)
            print(
                f"held finger, 100 Pa of drift, {level}: force changes by {100 * change:.1f} %, {wrong} wrong"
            )
        for boards in ("one", "all"):
            for offset in (300.0, 400.0):
                if wanted("idle"):
                    found = idle(level, offset, boards, 10 * n, seed)
                    print(f"idle, {offset:g} Pa on {boards}, {level}: {found} of {10 * n}", flush=True)
    if wanted("time"):
        speed(seed)


if __name__ == "__main__":
    main()
