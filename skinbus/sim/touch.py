"""Touches: what presses where, how hard, and when.

Position and force are piecewise linear in time between keys. A path is linear in the chart and may pass
through the wrap of a closed surface: from 170 to 190 degrees is 20 degrees on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinbus.arrays import Floats, Ints32
from skinbus.model import Arm
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.layer import Loads


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
    def pull(self) -> tuple[float, float]:
        """Tangential force per normal force, along s and a."""
        return self.inclination * np.cos(self.direction), self.inclination * np.sin(self.direction)

    @property
    def indenter(self) -> Indenter:
        """What presses."""
        modulus = self.modulus if self.shape is Shape.SPHERE else 0.0
        return Indenter(self.shape, self.length, self.width, modulus)

    def at(self, t_s: float) -> tuple[float, float, float]:
        """Return s (m), a (m) and force (N) at a time; of two keys of one time the later one holds."""
        s, a = (float(np.interp(t_s, self.path[:, 0], self.path[:, k])) for k in (1, 2))
        return s, a, float(np.interp(t_s, self.force[:, 0], self.force[:, 1]))

    def radius(self, force: float) -> float:
        """Return the radius of the contact (m); Hertz: a^3 = 3 F R / (4 E*), eq. 4.22 of Johnson."""
        if self.shape is not Shape.SPHERE:
            return 0.5 * self.length
        grown = (0.375 * self.length / self.modulus * force) ** (1.0 / 3.0)
        return float(min(grown, 0.999999 * 0.5 * self.length))


@dataclass(frozen=True, slots=True, eq=False)
class Touches:
    """The touches that press at one time, as columns: the truth that contacts are compared with."""

    link: Ints32
    s: Floats
    """m"""
    a: Floats
    """m, wrapped"""
    force: Floats
    """N, above zero"""
    touch: Ints32
    """Number of the touch in the scene."""

    def __len__(self) -> int:
        return len(self.link)


class TouchPlan:
    """All touches of a scene, and the loads they make at a time."""

    def __init__(self, arm: Arm, touches: Sequence[Touch]) -> None:
        self._touches, self._period = touches, arm.link_shapes[:, 2]
        self._times = np.array([(touch.start, touch.end) for touch in touches]).reshape(-1, 2)
        known: dict[Indenter, int] = {}
        self._numbers = np.array([known.setdefault(touch.indenter, len(known)) for touch in touches])
        self._pushes = np.array([(touch.yaw, *touch.pull) for touch in touches]).reshape(-1, 3)
        self.indenters = list(known) or [Indenter()]
        """The distinct indenters; their numbers are those of the loads."""
        self.loads = Loads(max(1, len(touches)))

    def at(self, t_s: float) -> Touches:
        """Return the touches at a time."""
        within = np.flatnonzero((self._times[:, 0] <= t_s) & (t_s < self._times[:, 1])).tolist()
        found = [(j, *self._touches[j].at(t_s)) for j in within]
        touch, s, a, force = np.array([row for row in found if row[3] > 0.0]).reshape(-1, 4).T
        touch = touch.astype(np.int32)
        link = np.array([self._touches[j].link for j in touch], np.int32)
        period = self._period[link]
        turns = np.round(np.divide(a, period, out=np.zeros(len(a)), where=period > 0.0))
        return Touches(link, s, a - period * turns, force, touch)

    def load(self, t_s: float) -> Loads:
        """Return the loads at a time, one for each touch that presses, in the plan's own columns."""
        now, loads = self.at(t_s), self.loads
        n = loads.n = len(now)
        loads.link[:n], loads.s[:n], loads.a[:n], loads.force[:n] = now.link, now.s, now.a, now.force
        loads.indenter[:n] = self._numbers[now.touch]
        loads.yaw[:n], loads.pull_s[:n], loads.pull_a[:n] = self._pushes[now.touch].T
        for i, j in enumerate(now.touch.tolist()):
            loads.radius[i] = self._touches[j].radius(float(now.force[i]))
        return loads
