"""Touches: what presses where, how hard, and when; and what an indenter's shape does to the load.

Position and force are piecewise linear in time between keys. A path is linear in the chart and may pass
through the wrap of a closed surface: from 170 to 190 degrees is 20 degrees on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
import numpy.typing as npt
from numba import njit

from skinbus.model import Arm
from skinbus.sim.layer import Ints, Loads

Floats = npt.NDArray[np.float64]

PALM_STEP: Final = 4e-3
"""Largest spacing of the loads of an edge or a palm, m; a layer of 6 mm shows less than 1 % of ripple."""


class Shape(IntEnum):
    """What presses."""

    POINT = 0
    DISC = 1
    EDGE = 2
    PALM = 3


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
    """Diameter of a disc, length of an edge or palm, m."""
    width: float = 0.0
    """Width of a palm, m."""
    yaw: float = 0.0
    """Direction of an edge's or palm's length, rad from s towards a."""

    @property
    def start(self) -> float:
        """Time of the first force key, s."""
        return float(self.force[0, 0])

    @property
    def end(self) -> float:
        """Time of the last force key, s."""
        return float(self.force[-1, 0])

    def elements(self) -> Floats:
        """Return the loads of the indenter, (n, 3): offsets along s and a (m), share of the force."""
        if self.shape in (Shape.POINT, Shape.DISC):
            return np.array([[0.0, 0.0, 1.0]])
        u, share_u = _line(self.length)
        # an edge carries an even line load; a palm is soft: its pressure falls off as a paraboloid
        if self.shape is Shape.EDGE:
            v, share = np.zeros(1), share_u[:, None]
        else:
            v, share_v = _line(self.width)
            fall = 1.0 - (2.0 * u[:, None] / self.length) ** 2 - (2.0 * v / self.width) ** 2
            share = share_u[:, None] * share_v * np.maximum(fall, 0.0)
        x, y = (
            np.cos(self.yaw) * u[:, None] - np.sin(self.yaw) * v,
            np.sin(self.yaw) * u[:, None] + np.cos(self.yaw) * v,
        )
        elements = np.stack([x.ravel(), y.ravel(), share.ravel() / share.sum()], -1)
        return np.asarray(elements[elements[:, 2] > 0.0])


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


class TouchPlan:
    """All touches of a scene compiled to flat columns, and the loads they make at a time."""

    def __init__(self, arm: Arm, touches: Sequence[Touch]) -> None:
        keys = [_keys(touch) for touch in touches]
        self._start = np.concatenate([[0], np.cumsum([len(k) for k in keys])]).astype(np.int32)
        self._keys = np.ascontiguousarray(np.concatenate([np.zeros((0, 4)), *keys]))
        self._link = np.array([touch.link for touch in touches], np.int32)
        elements = [touch.elements() for touch in touches]
        self._first = np.concatenate([[0], np.cumsum([len(e) for e in elements])]).astype(np.int32)
        self._elements = np.ascontiguousarray(np.concatenate([np.zeros((0, 3)), *elements]))
        radii = [0.5 * touch.length if touch.shape is Shape.DISC else 0.0 for touch in touches]
        self.indenters, rows = np.unique(np.array(radii or [0.0]), return_inverse=True)
        self._indenter = rows.astype(np.int32)
        self._links = (arm.link_radius, arm.link_taper, arm.link_length, arm.link_period)
        self._now = (np.zeros(len(touches), np.int32), np.zeros((len(touches), 3)))
        self.loads = Loads(max(1, len(self._elements)))

    def at(self, t_s: float) -> Touches:
        """Return the touches at a time."""
        touch, value = self._now
        n = _values(t_s, self._start, self._keys, touch, value)
        link = self._link[touch[:n]]
        period = self._links[3][link]
        turns = np.round(np.divide(value[:n, 1], period, out=np.zeros(n), where=period > 0.0))
        return Touches(
            link, value[:n, 0].copy(), value[:n, 1] - period * turns, value[:n, 2].copy(), touch[:n].copy()
        )

    def load(self, t_s: float) -> Loads:
        """Return the loads at a time, in the plan's own columns."""
        touch, value = self._now
        n = _values(t_s, self._start, self._keys, touch, value)
        loads = self.loads
        radius, taper, length, _ = self._links
        loads.n = _spread(
            n,
            touch,
            value,
            self._link,
            self._indenter,
            self._first,
            self._elements,
            radius,
            taper,
            length,
            loads.link,
            loads.s,
            loads.a,
            loads.force,
            loads.indenter,
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


def _line(length: float) -> tuple[Floats, Floats]:
    """Return midpoints (n,) m and equal shares of cells no longer than PALM_STEP that fill a length."""
    n = max(1, int(np.ceil(length / PALM_STEP)))
    return (np.arange(n) + 0.5) / n * length - 0.5 * length, np.full(n, 1.0 / n)


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def _spread(
    n: int,
    touch: Ints,
    value: Floats,
    touch_link: Ints,
    touch_indenter: Ints,
    first: Ints,
    elements: Floats,
    link_radius: Floats,
    link_taper: Floats,
    link_length: Floats,
    load_link: Ints,
    load_s: Floats,
    load_a: Floats,
    load_force: Floats,
    load_indenter: Ints,
) -> int:
    """Write the loads that make up the touches; return how many."""
    m = 0
    for i in range(n):
        j = touch[i]
        k = touch_link[j]
        for e in range(first[j], first[j + 1]):
            s = value[i, 0] + elements[e, 0]
            r = link_radius[k] + link_taper[k] * (s - 0.5 * link_length[k])
            load_link[m] = k
            load_s[m] = s
            load_a[m] = (
                value[i, 1] + elements[e, 1] * link_radius[k] / r
            )  # an arc at s is r/radius of that in a
            load_force[m] = value[i, 2] * elements[e, 2]
            load_indenter[m] = touch_indenter[j]
            m += 1
    return m
