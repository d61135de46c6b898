"""Touches: what presses where, how hard, and when.

Position and force are piecewise linear in time between keys. A path is linear in the chart and may pass
through the wrap of a closed surface: from 170 to 190 degrees is 20 degrees on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.jit import kernel
from skinbus.model import Arm
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.layer import Ints, Loads

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Touch:
    """One touch of a scene: keys of position and of force over scene time."""

    link: int
    path: Floats
    """(n, 3): t (s), s (m), a (m, not wrapped)"""
    force: Floats
    """(n, 2): t (s), F (N)"""
    shape: Shape = Shape.POINT
    length: float = 0.0
    """Diameter of a disc or sphere, length of an edge or palm, m."""
    width: float = 0.0
    """Width of a palm, m."""
    yaw: float = 0.0
    """Direction of an edge's or palm's length, rad from s towards a."""
    modulus: float = 0.0
    """Contact modulus of a sphere on the cover, Pa."""
    inclination: float = 0.0
    """Tangential force per normal force; acts where the scene names the effect ``shear``."""
    direction: float = 0.0
    """Of the tangential force, rad from s towards a."""

    @property
    def start(self) -> float:
        """Time of the first force key, s."""
        return float(self.force[0, 0])

    @property
    def end(self) -> float:
        """Time of the last force key, s."""
        return float(self.force[-1, 0])

    @property
    def indenter(self) -> Indenter:
        """What presses."""
        modulus = self.modulus if self.shape is Shape.SPHERE else 0.0
        return Indenter(self.shape, self.length, self.width, modulus)


@dataclass(frozen=True, slots=True, eq=False)
class Touches:
    """The touches that press at one time, as columns: the truth that contacts are compared with."""

    link: Ints
    s: Floats
    """m"""
    a: Floats
    """m, wrapped"""
    force: Floats
    """N, above zero"""
    touch: Ints
    """Number of the touch in the scene."""

    def __len__(self) -> int:
        return len(self.link)


class TouchRows(NamedTuple):
    """What does not change of each touch, (n_touches,); see :class:`Touch` and ``layer.Loads``."""

    link: Ints
    indenter: Ints
    is_sphere: npt.NDArray[np.bool_]
    size: Floats
    """Contact radius, at most, m."""
    softness: Floats
    """m^3/N, by which the cube of a sphere's contact radius grows with the force"""
    yaw: Floats
    pull_s: Floats
    pull_a: Floats


class TouchPlan:
    """All touches of a scene compiled to flat columns, and the loads they make at a time."""

    def __init__(self, arm: Arm, touches: Sequence[Touch]) -> None:
        keys = [_keys(touch) for touch in touches]
        self._start = np.concatenate([[0], np.cumsum([len(k) for k in keys])]).astype(np.int32)
        self._keys = np.ascontiguousarray(np.concatenate([np.zeros((0, 4)), *keys]))
        self._link = np.array([touch.link for touch in touches], np.int32)
        known: dict[Indenter, int] = {}
        numbers = [known.setdefault(touch.indenter, len(known)) for touch in touches]
        self.indenters = list(known) or [Indenter()]
        """The distinct indenters; their numbers are those of the loads."""
        self._rows = TouchRows(
            link=self._link,
            indenter=np.array(numbers, np.int32),
            is_sphere=np.array([touch.shape is Shape.SPHERE for touch in touches], np.bool_),
            size=np.array([0.5 * touch.length for touch in touches]),
            # Hertz: a^3 = 3 F R / (4 E*), eq. 4.22 of Johnson
            softness=np.array(
                [
                    0.375 * touch.length / touch.modulus if touch.shape is Shape.SPHERE else 0.0
                    for touch in touches
                ]
            ),
            yaw=np.array([touch.yaw for touch in touches]),
            pull_s=np.array([touch.inclination * np.cos(touch.direction) for touch in touches]),
            pull_a=np.array([touch.inclination * np.sin(touch.direction) for touch in touches]),
        )
        self._period = arm.link_period
        self._now = (np.zeros(len(touches), np.int32), np.zeros((len(touches), 3)))
        self.loads = Loads(max(1, len(touches)))

    def at(self, t_s: float) -> Touches:
        """Return the touches at a time."""
        touch, value = self._now
        n = _values(t_s, self._start, self._keys, touch, value)
        link = self._link[touch[:n]]
        period = self._period[link]
        turns = np.round(np.divide(value[:n, 1], period, out=np.zeros(n), where=period > 0.0))
        return Touches(
            link, value[:n, 0].copy(), value[:n, 1] - period * turns, value[:n, 2].copy(), touch[:n].copy()
        )

    def load(self, t_s: float) -> Loads:
        """Return the loads at a time, one for each touch that presses, in the plan's own columns."""
        touch, value = self._now
        n = _values(t_s, self._start, self._keys, touch, value)
        loads = self.loads
        loads.n = n
        _load(
            n,
            touch,
            value,
            self._rows,
            loads.link,
            loads.s,
            loads.a,
            loads.force,
            loads.indenter,
            loads.radius,
            loads.yaw,
            loads.pull_s,
            loads.pull_a,
        )
        return loads


def _keys(touch: Touch) -> Floats:
    """Return path and force on one set of times, (n, 4): t, s, a, F."""
    inside = (touch.path[:, 0] > touch.start) & (touch.path[:, 0] < touch.end)
    # a step of force is two keys at one time: keep both
    times = np.sort(
        np.concatenate([touch.force[:, 0], np.setdiff1d(touch.path[inside, 0], touch.force[:, 0])])
    )
    force = np.interp(times, touch.force[:, 0], touch.force[:, 1])
    force[np.isin(times, touch.force[:, 0])] = touch.force[:, 1]
    s = np.interp(times, touch.path[:, 0], touch.path[:, 1])
    a = np.interp(times, touch.path[:, 0], touch.path[:, 2])
    return np.stack([times, s, a, force], -1)


@kernel
def _values(t: float, start: Ints, keys: Floats, touch: Ints, value: Floats) -> int:
    """Fill in which touches press at t and their (s, a, F); return how many."""
    n = 0
    for j in range(len(start) - 1):
        first, last = start[j], start[j + 1] - 1
        if not keys[first, 0] <= t < keys[last, 0]:
            continue
        k = first
        while keys[k + 1, 0] <= t:
            k += 1
        x = (t - keys[k, 0]) / (keys[k + 1, 0] - keys[k, 0])
        force = keys[k, 3] + x * (keys[k + 1, 3] - keys[k, 3])
        if force > 0.0:
            touch[n] = j
            value[n, 0] = keys[k, 1] + x * (keys[k + 1, 1] - keys[k, 1])
            value[n, 1] = keys[k, 2] + x * (keys[k + 1, 2] - keys[k, 2])
            value[n, 2] = force
            n += 1
    return n


@kernel
def _load(
    n: int,
    touch: Ints,
    value: Floats,
    rows: TouchRows,
    link: Ints,
    s: Floats,
    a: Floats,
    force: Floats,
    indenter: Ints,
    radius: Floats,
    yaw: Floats,
    pull_s: Floats,
    pull_a: Floats,
) -> None:
    """Write the loads of the touches that press."""
    for i in range(n):
        j = touch[i]
        link[i] = rows.link[j]
        s[i], a[i], force[i] = value[i]
        indenter[i] = rows.indenter[j]
        radius[i] = rows.size[j]
        if rows.is_sphere[j]:
            radius[i] = min((rows.softness[j] * force[i]) ** (1.0 / 3.0), 0.999999 * rows.size[j])
        yaw[i] = rows.yaw[j]
        pull_s[i], pull_a[i] = rows.pull_s[j], rows.pull_a[j]
