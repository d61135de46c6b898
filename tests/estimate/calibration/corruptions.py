"""Boards that are pressed with errors of place and force, what may be wrong in a file of presses, and what
comes of it."""

from dataclasses import dataclass, replace

import numpy as np

from skinbus.estimate import Estimator
from skinbus.estimate.calibration.gate import Judgement, judge
from skinbus.estimate.calibration.table import PressTable
from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface, Transducer
from skinbus.model.patch import grid
from skinbus.sim.laws import Elastic
from tests.skins import feel_of, shipped_law

LIMIT_M = 1e-3
"""Error of places above which nothing may be accepted without a word."""
SAID = 1.5
"""By which an error that is said may be exceeded: quantiles of 40 touches differ by half."""
LAYOUTS = [grid(4, 4, 0.010), grid(4, 2, 0.0099), grid(5, 3, 0.012)]


@dataclass
class PressedBoards:
    """Boards drawn at random, how they are pressed, and what they truly read."""

    arm: Arm
    table: PressTable
    read: object
    """Readings (n, n_tactels) Pa for true touches (n, 3): s, a, force."""
    rng: object

    @classmethod
    def draw(cls, rng, n=1):
        """Return n boards of a kind, pressed 60 times each; layout, link, gains, noise, converter vary."""
        uv = LAYOUTS[rng.integers(3)]
        bits, converter = [(16, 12), (16, 16), (8, 8), (16, 10)][rng.integers(4)]
        transducer = Transducer(
            full_scale=float(rng.choice([100e3, 250e3])), bits=bits, converter_bits=converter
        )
        size = np.ptp(uv, axis=0) + 0.010
        patch = Patch(
            tactels_uv=uv, size=tuple(size), transducer=transducer, law=shipped_law(), threshold=1000.0
        )
        far = float(np.hypot(*size)) + 0.004
        length = 0.06 + far * n
        surface = [Surface.cylinder(length, 0.05), Surface.plane(length, 0.2)][rng.integers(2)]
        a, yaw = float(rng.uniform(-0.03, 0.03)), float(rng.choice([0.0, 0.5 * np.pi, 0.3]))
        placed = [
            PlacedPatch(patch=patch, node_id=5 + k, link=0, s=0.03 + far * (k + 0.5), a=a, yaw=yaw)
            for k in range(n)
        ]
        arm = Arm("drawn", [Link("link", surface)], placed)
        feel = feel_of(arm, Elastic(), float(rng.uniform(0.002, 0.007)))
        gain = 1.0 + rng.choice([0.03, 0.08]) * rng.standard_normal(arm.n_tactels)
        noise = float(rng.choice([20.0, 60.0, 150.0]))

        def read(touches):
            felt = np.array([feel(touch[None]) for touch in touches]) * gain
            return transducer.pressure(transducer.counts(felt + noise * rng.standard_normal(felt.shape)))

        patch, force = np.repeat(np.arange(n), 60), rng.uniform(3.0, 15.0, 60 * n)
        if same := rng.random() < 0.3:
            force[:] = 8.0
        places = [rng.uniform(uv.min(axis=0) - 0.004, uv.max(axis=0) + 0.004, (60, 2)) for _ in placed]
        s, a = np.concatenate([arm.on_link(p, at) for p, at in enumerate(places)], axis=1)
        readings = read(np.column_stack([s, a, force]))
        readings[patch[:, None] != arm.tactel_patch] = np.nan
        off, off_force = rng.uniform(0.05e-3, 0.3e-3), rng.uniform(0.005, 0.03)
        s, a = np.array([s, a]) + off * rng.standard_normal((2, len(s)))
        force = None if same else force * (1.0 + off_force * rng.standard_normal(len(s)))
        return cls(
            arm, PressTable(arm=arm, patch=patch, s=s, a=a, force=force, pressures=readings), read, rng
        )

    def error(self, arm):
        """Return the error of places (m, 68 %) of an arm that holds a calibration, at new touches."""
        off, estimator = [], Estimator(arm, "fit")
        for p, placed in enumerate(self.arm.patches):
            uv = np.asarray(placed.patch.tactels_uv)
            s, a = self.arm.on_link(p, self.rng.uniform(uv.min(axis=0), uv.max(axis=0), (40, 2)))
            touches = np.column_stack([s, a, self.rng.uniform(4.0, 12.0, 40)])
            readings = self.read(touches) * (arm.tactel_gain / self.arm.tactel_gain)
            for k, row in enumerate(readings):
                found = estimator.update(row, 1000 * p + k)
                best = found.force.argmax() if len(found) else 0
                off.append(np.hypot(found.s[best] - s[k], found.a[best] - a[k]) if len(found) else 1.0)
        return float(np.quantile(off, 0.68))


def outcome(seed, corrupt, n):
    """Return the judgement of presses on n boards, corrupted, and what comes of it in words."""
    rng = np.random.default_rng(seed)
    boards = PressedBoards.draw(rng, n)
    judgement: Judgement = judge(corrupt(boards.table, rng))
    if judgement.faults:
        return judgement, "refused"
    error = boards.error(judgement.calibration.apply(boards.arm))
    # too coarse a board for better places, which the judgement says
    is_said = judgement.place_error > LIMIT_M and error < SAID * judgement.place_error
    return judgement, "accepted" if error < LIMIT_M else "accepted and said" if is_said else f"WRONG: {error}"


def moved(turn, shift=(0.0, 0.0)):
    """Places on boards, turned by a matrix and shifted (m)."""

    def corrupt(table, rng):
        s, a = np.zeros((2, len(table)))
        for p in range(table.arm.n_patches):
            rows = table.patch == p
            s[rows], a[rows] = table.arm.on_link(p, table.uv()[rows] @ np.transpose(turn) + shift)
        return replace(table, s=s, a=a)

    return corrupt


def in_unit(by_s, by_a):
    """Places in other units."""
    return lambda table, rng: replace(table, s=by_s * table.s, a=by_a * table.a)


def swapped(table, rng):
    """s and a in each other's columns."""
    return replace(table, s=table.a, a=table.s)


def slipped(table, rng):
    """Readings a row away from their places."""
    return replace(table, pressures=np.roll(table.pressures, 1, axis=0))


def boards_exchanged(table, rng):
    """Readings of one board under the node-ID of another; of a board alone, in another order."""
    n, flip = table.arm.n_patches, table.arm.n_tactels // table.arm.n_patches
    if n == 1:
        return replace(table, pressures=table.pressures[:, ::-1])
    return replace(table, patch=(table.patch + 1) % n, pressures=np.roll(table.pressures, flip, axis=1))


def forces(factor, lag=0):
    """Forces off by a factor, or of other rows; places, where forces are not known."""

    def corrupt(table, rng):
        known = table.force is not None
        return replace(table, force=factor * np.roll(table.force, lag)) if known else swapped(table, rng)

    return corrupt


def outliers(what):
    """A tenth of the rows with a place, a force or readings of their own."""

    def corrupt(table, rng):
        rows = rng.choice(len(table), len(table) // 10, replace=False)
        s, a, pressures, force = table.s.copy(), table.a.copy(), table.pressures.copy(), table.force
        if what == "force" and force is not None:
            force = force.copy()
            force[rows] *= rng.choice([0.1, 10.0, 3.0], len(rows))
        elif what == "readings":
            for row in rows:
                own = table.arm.tactels_of(table.patch[row])
                pressures[row, own] = rng.permutation(pressures[row, own])
        else:
            angle, far = rng.uniform((0.0, 2e-3), (2.0 * np.pi, 20e-3), (len(rows), 2)).T
            s[rows] += far * np.cos(angle)
            a[rows] += far * np.sin(angle)
        return replace(table, s=s, a=a, force=force, pressures=pressures)

    return corrupt


STRAIGHT, MIRRORED, QUARTER = ((1, 0), (0, 1)), ((-1, 0), (0, 1)), ((0, -1), (1, 0))
TILTED = ((np.cos(0.1), -np.sin(0.1)), (np.sin(0.1), np.cos(0.1)))

CORRUPTIONS = {
    "s and a swapped": swapped,
    "places in m": in_unit(1e-3, 1e-3),
    "places in inches": in_unit(1.0 / 25.4, 1.0 / 25.4),
    "a in cm": in_unit(1.0, 0.1),
    "s in um": in_unit(1e3, 1.0),
    "boards mirrored": moved(MIRRORED),
    "boards turned by 90 degrees": moved(QUARTER),
    "boards turned by 180 degrees": moved(-np.eye(2)),
    "boards turned by 6 degrees": moved(TILTED),
    "places 2 mm off": moved(STRAIGHT, (0.0, 2e-3)),
    "places 10 mm off": moved(STRAIGHT, (-8e-3, 6e-3)),
    "readings a row late": slipped,
    "boards exchanged": boards_exchanged,
    "forces 10 times": forces(10.0),
    "forces of other rows": forces(1.0, 2),
    **{f"outliers of {what}": outliers(what) for what in ("place", "force", "readings")},
}
"""Names and what makes a table of presses wrong: (table, rng) -> table."""
