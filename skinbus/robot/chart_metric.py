"""How far places of a chart are from a tactel: its scale there, and how the distance departs from it.

On a conformal chart the metric is ``exp(2 phi) |dz|^2``, where ``exp(-phi)`` is the scale. Around each
tactel phi is the polynomial that fits the corners of the chart best; geodesics are shot over it in all
directions, and ``model.bend`` is fitted to where they end.

Source: in such a metric geodesics are rays of light where the index of refraction is ``exp(phi)``: they turn
by the slope of phi across them (M. Born, E. Wolf, Principles of Optics, 3.2).
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from skinbus.model.bend import COLUMNS, EXPONENTS, MOST, POWERS
from skinbus.robot.flattening import EDGE, Flattening

Floats = npt.NDArray[np.float64]

REACH: Final = 0.04
"""m, to which distances are fitted: the laws of covers of up to 10 mm end at 30 mm."""
FIT: Final = 0.05
"""m around a tactel over which phi is fitted: ``REACH``, and 10 mm so that its rim is determined."""
DEGREE: Final = 4
"""Of phi. On an ellipsoid of half axes 90, 70 and 60 mm the third errs by 0.7 % at 5 mm, this one by 0.2 %,
and the sixth is not better."""
NEAR: Final = 0.1
"""Of ``FIT``: beyond it the weight of a corner falls with its distance, as presses are felt most nearby."""
FLAT: Final = 1e-4
"""Part of a distance of 20 mm below which its correction is left out: 2 um. What can be unrolled
needs none."""
_FLAT_AT: Final = 0.02
_TERMS: Final = tuple((n - k, k) for n in range(DEGREE + 1) for k in range(n + 1))
_RANK: Final = 1e-4
"""Of singular values: what corners beside a rim do not determine stays zero."""
_DIRECTIONS: Final = 16
_STEP: Final = 0.005
"""m, of the geodesics, and between the places on them that count: Runge and Kutta's error is below 1 um."""


class ChartMetric:
    """The metric of a chart around places."""

    def __init__(self, chart: Flattening) -> None:
        corner, first = np.unique(chart.triangles, return_index=True)
        places, phi = chart.corners.reshape(-1, 2)[first], -np.log(chart.scale)[corner]
        if chart.period:  # what lies over the ends is there once more
            over = np.array([0.0, chart.period])
            places, phi = np.concatenate([places, places - over, places + over]), np.tile(phi, 3)
        self._places, self._phi, self._tree = places, phi, cKDTree(places)

    def around(self, places: Floats) -> Floats:
        """Return s, a (m), scale and bend (n, 12) of places (n, 2) m."""
        phi = np.array([self._fitted(place) for place in places]).reshape(-1, len(_TERMS))
        ends, length = _geodesics(phi), _STEP * np.arange(1, _steps() + 1)[:, None]
        rows = np.zeros((len(places), 3 + COLUMNS))
        rows[:, :2], rows[:, 2] = places, np.exp(-phi[:, 0])
        for row, (x, y) in zip(rows, ends, strict=True):
            row[3:] = self._bend(row[:2], length * row[2] / np.hypot(x, y), x, y)
        rows[:, 3:][np.abs(rows[:, 3:] * _FLAT_AT**POWERS).max(axis=1) < FLAT] = 0.0
        return rows

    def _fitted(self, place: Floats) -> Floats:
        """Return the coefficients of phi around a place, by ``_TERMS`` of parts of ``FIT``."""
        near = self._tree.query_ball_point(place, FIT) or [int(self._tree.query(place)[1])]
        (x, y), phi = (self._places[near] - place).T / FIT, self._phi[near]
        weight = 1.0 / (NEAR + np.hypot(x, y))
        terms = np.stack([x**i * y**j for i, j in _TERMS], -1) * weight[:, None]
        # of the normal equations: 15 columns of thousands of corners
        solved = np.linalg.lstsq(terms.T @ terms, terms.T @ (weight * phi), rcond=_RANK**2)
        return np.asarray(solved[0])

    def _bend(self, place: Floats, ratio: Floats, x: Floats, y: Floats) -> Floats:
        """Return the row (9,) that best fits ratios of distances to places (x, y) m from here."""
        fine = np.isfinite(ratio) & (ratio > 1.0 / MOST) & (ratio < MOST)
        x, y, ratio = x[fine], y[fine], ratio[fine]
        on = self._tree.query(np.stack([x, y], -1) + place, distance_upper_bound=EDGE)[0] < EDGE
        terms = np.stack([(x[on] / REACH) ** i * (y[on] / REACH) ** j for i, j in EXPONENTS], -1)
        weight = (np.hypot(x[on], y[on]) / REACH) ** -0.5  # half way from equal parts to equal lengths
        fitted = np.linalg.lstsq(terms * weight[:, None], (ratio[on] - 1.0) * weight, rcond=10.0 * _RANK)
        return np.asarray(fitted[0] / REACH**POWERS)


def _steps() -> int:
    return round(REACH / _STEP)


def _geodesics(phi: Floats) -> Floats:
    """Return where geodesics from n places are (n, 2, steps, directions) m, by phi around them (n, terms)."""
    by = [phi[:, k, None] for k in range(len(_TERMS))]

    def slope(state: Floats) -> Floats:
        (x, y), angle = state[:2] / FIT, state[2]
        xs, ys = [np.ones_like(x), x], [np.ones_like(y), y]
        for _ in range(DEGREE - 1):
            xs.append(xs[-1] * x)
            ys.append(ys[-1] * y)
        value, by_x, by_y = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
        for c, (i, j) in zip(by, _TERMS, strict=True):
            value += c * xs[i] * ys[j]
            if i:
                by_x += i * c * xs[i - 1] * ys[j]
            if j:
                by_y += j * c * xs[i] * ys[j - 1]
        cos, sin, scale = np.cos(angle), np.sin(angle), np.exp(-value)
        return np.stack([scale * cos, scale * sin, scale * (by_y * cos - by_x * sin) / FIT])

    state = np.zeros((3, len(phi), _DIRECTIONS))
    state[2] = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    ends, h = [], _STEP
    with np.errstate(over="ignore", invalid="ignore"):  # beyond the rim phi is extrapolated
        for _ in range(_steps()):
            k1 = slope(state)
            k2 = slope(state + 0.5 * h * k1)
            k3 = slope(state + 0.5 * h * k2)
            state = state + h / 6.0 * (k1 + 2.0 * (k2 + k3) + slope(state + h * k3))
            ends.append(state[:2])
    return np.asarray(np.moveaxis(np.array(ends), 2, 0).swapaxes(1, 2))
