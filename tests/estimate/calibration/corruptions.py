"""Boards that are pressed with errors of place and force, and what may be wrong in a file of presses."""

from dataclasses import dataclass, replace

import numpy as np

from skinbus.estimate import Estimator
from skinbus.estimate.calibration import PressTable
from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface, Transducer
from skinbus.model.patch import grid
from skinbus.sim.laws import Elastic
from tests.skins import feel_of, hexagon, shipped_law


@dataclass
class PressedBoards:
    """Boards drawn at random, how they are pressed, and what they truly read."""

    arm: Arm
    table: PressTable
    read: object
    """Readings (n, n_tactels) Pa for true touches (n, 3): s, a, force."""
    rng: object

    @classmethod
    def draw(cls, rng, small=False):
        """Return boards of one kind on a plane or a tube; layout, gains, noise, converter, presses vary.

        ``small``: one board of few tactels, pressed 60 times.
        """
        uv = [
            grid(4, 4, 0.010),
            grid(6, 6, 0.008),
            grid(4, 2, 0.0099),
            grid(5, 3, 0.012),
            hexagon(),
        ][rng.choice([0, 2, 3]) if small else rng.integers(5)]
        size = np.ptp(uv, axis=0) + 0.010
        bits, converter = [(16, 12), (16, 16), (8, 8), (16, 10)][rng.integers(4)]
        transducer = Transducer(
            full_scale=float(rng.choice([100e3, 250e3])), bits=bits, converter_bits=converter
        )
        patch = Patch(
            tactels_uv=uv, size=tuple(size), transducer=transducer, law=shipped_law(), threshold=1000.0
        )
        n_boards = 1 if small else int(rng.integers(1, 4))
        yaw = float(rng.choice([0.0, 0.0, 0.5 * np.pi, 0.3]))
        far = float(np.hypot(*size)) + 0.004
        tube = rng.random() < 0.5
        length = 0.06 + far * n_boards
        surface = Surface.cylinder(length, 0.05) if tube else Surface.plane(length, 0.2)
        a = float(rng.uniform(-0.03, 0.03))
        placed = [
            PlacedPatch(patch=patch, node_id=5 + k, link=0, s=0.03 + far * (k + 0.5), a=a, yaw=yaw)
            for k in range(n_boards)
        ]
        arm = Arm("drawn", [Link("link", surface)], placed)
        feel = feel_of(arm, Elastic(), float(rng.uniform(0.002, 0.007)))
        gain = 1.0 + rng.choice([0.03, 0.08]) * rng.standard_normal(arm.n_tactels)
        noise = float(rng.choice([20.0, 60.0, 150.0]))

        def read(touches):
            felt = np.array([feel(touch[None]) for touch in touches]) * gain
            noisy = felt + noise * rng.standard_normal(felt.shape)
            return transducer.pressure(transducer.counts(noisy))

        each = 60 if small else int(rng.integers(60, 140))
        return cls(arm, cls._pressed(arm, read, rng, each), read, rng)

    @staticmethod
    def _pressed(arm, read, rng, each):
        one_force = rng.random() < 0.3
        force = rng.uniform(3.0, 15.0, each * arm.n_patches)
        if one_force:
            force[:] = 8.0
        places = []
        for p in range(arm.n_patches):
            uv = np.asarray(arm.patches[p].patch.tactels_uv)
            low, high = uv.min(axis=0) - 0.004, uv.max(axis=0) + 0.004
            at = rng.uniform(low, high, (each, 2))
            if rng.random() < 0.4:  # in rows, as a robot does
                columns = int(np.ceil(np.sqrt(each)))
                steps = np.stack(np.divmod(np.arange(each), columns), -1) / (columns - 1)
                at = low + steps * (high - low)
            places.append(arm.on_link(p, at))
        (s, a), patch = np.concatenate(places, axis=1), np.repeat(np.arange(arm.n_patches), each)
        readings = read(np.column_stack([s, a, force]))
        for p in range(arm.n_patches):
            readings[patch != p, arm.tactels_of(p)] = np.nan
        place_error, force_error = rng.uniform(0.05, 0.3) * 1e-3, rng.uniform(0.005, 0.03)
        return PressTable(
            arm=arm,
            patch=patch,
            s=s + place_error * rng.standard_normal(len(s)),
            a=a + place_error * rng.standard_normal(len(s)),
            force=None
            if one_force and rng.random() < 0.5
            else force * (1.0 + force_error * rng.standard_normal(len(s))),
            pressures=readings,
        )

    def error(self, arm):
        """Return the error of places (m, 68 %) of an arm that holds a calibration, at new touches."""
        rng, off = self.rng, []
        estimator = Estimator(arm, "fit")
        gain = np.asarray(arm.tactel_gain) / np.asarray(self.arm.tactel_gain)
        for p, placed in enumerate(self.arm.patches):
            uv = np.asarray(placed.patch.tactels_uv)
            at = rng.uniform(uv.min(axis=0), uv.max(axis=0), (40, 2))
            s, a = self.arm.on_link(p, at)
            readings = self.read(np.column_stack([s, a, rng.uniform(4.0, 12.0, 40)])) * gain
            for k, row in enumerate(readings):
                found = estimator.update(row, 1000 * p + k)
                if len(found):
                    best = int(found.force.argmax())
                    off.append(np.hypot(found.s[best] - s[k], found.a[best] - a[k]))
                else:
                    off.append(1.0)
        return float(np.quantile(off, 0.68))


def _chart(table, uv):
    s, a = np.zeros((2, len(table)))
    for p in range(table.arm.n_patches):
        rows = table.patch == p
        s[rows], a[rows] = table.arm.on_link(p, uv[rows])
    return replace(table, s=s, a=a)


def swapped(table, rng):
    """s and a in each other's columns."""
    return replace(table, s=table.a, a=table.s)


def units(table, rng):
    """Places in other units, in one column or both."""
    factor = float(rng.choice([1e-3, 0.1, 1.0 / 25.4, 1e3]))
    which = rng.integers(3)
    return replace(
        table, s=table.s * (factor if which != 1 else 1.0), a=table.a * (factor if which != 2 else 1.0)
    )


def turned(table, rng):
    """Boards mirrored or turned by right angles."""
    matrix = np.array(
        [
            ((0, 1), (1, 0)),
            ((-1, 0), (0, 1)),
            ((1, 0), (0, -1)),
            ((-1, 0), (0, -1)),
            ((0, -1), (1, 0)),
            ((0, 1), (-1, 0)),
        ][rng.integers(6)],
        float,
    )
    return _chart(table, table.uv() @ matrix.T)


def shifted(table, rng):
    """Places shifted by 1 to 15 mm."""
    angle, far = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(1e-3, 15e-3)
    return _chart(table, table.uv() + far * np.array([np.cos(angle), np.sin(angle)]))


def tilted(table, rng):
    """Boards turned by a few degrees."""
    angle = rng.choice([-1, 1]) * np.radians(rng.uniform(3.0, 30.0))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return _chart(table, table.uv() @ turn.T)


def slipped(table, rng):
    """Readings one or two rows away from their places, from some row on."""
    lag = int(rng.choice([-2, -1, 1, 2]))
    start = int(rng.choice([0, rng.integers(len(table) // 2)]))
    pressures = table.pressures.copy()
    rows = np.arange(start, len(table))
    for p in np.unique(table.patch):  # the rows of a board are read in their order
        own = rows[table.patch[rows] == p]
        pressures[own] = np.roll(table.pressures[own], lag, axis=0)
    return replace(table, pressures=pressures)


def outliers(table, rng):
    """Up to a tenth of the rows with a place, a force or readings of their own."""
    n = int(rng.integers(1, max(2, int(0.1 * len(table)) + 1)))
    rows = rng.choice(len(table), n, replace=False)
    s, a, pressures = table.s.copy(), table.a.copy(), table.pressures.copy()
    force = None if table.force is None else table.force.copy()
    kind = rng.integers(3)
    if kind == 0 or (kind == 1 and force is None):
        angle, far = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(2e-3, 20e-3, n)
        s[rows] += far * np.cos(angle)
        a[rows] += far * np.sin(angle)
    elif kind == 1:
        force[rows] *= rng.choice([0.1, 10.0, 3.0], n)
    else:
        for row in rows:
            own = table.arm.tactels_of(int(table.patch[row]))
            pressures[row, own] = rng.permutation(pressures[row, own])
    return replace(table, s=s, a=a, force=force, pressures=pressures)


def boards_exchanged(table, rng):
    """Readings of one board under the node-ID of another; of a board alone, in another order."""
    n = table.arm.n_patches
    pressures = np.full_like(table.pressures, np.nan)
    order = np.roll(np.arange(n), 1)
    if n == 1:
        pressures[:] = table.pressures[:, ::-1]
        return replace(table, pressures=pressures)
    patch = order[table.patch]
    for p in range(n):
        rows = table.patch == p
        pressures[rows, table.arm.tactels_of(int(order[p]))] = table.pressures[rows, table.arm.tactels_of(p)]
    return replace(table, patch=patch, pressures=pressures)


def forces(table, rng):
    """Forces in other units or off by powers of ten; of other rows."""
    if table.force is None:
        return swapped(table, rng)
    if rng.random() < 0.3:
        return replace(table, force=np.roll(table.force, int(rng.integers(1, 4))))
    return replace(table, force=table.force * float(rng.choice([0.001, 0.01, 0.1, 10.0, 100.0, 1000.0])))


CORRUPTIONS = (
    swapped,
    units,
    turned,
    shifted,
    tilted,
    slipped,
    outliers,
    boards_exchanged,
    forces,
)
