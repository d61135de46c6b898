"""What a skin can feel where: the least force that is registered, and the bound on place and force.

For each point of the links' surfaces, from the laws, noises and thresholds that the boards declare:

* the least force that level ``kmeans`` registers if readings had no noise: tactels from their threshold on
  count, and their sum of (p / sigma)^2 must reach the evidence that makes a contact;
* the Cramer-Rao bound of place and force of a contact alone, J' V^-1 J inverted with J = dp / d(s, a, F) and
  V the variance of a reading: noise, rounding of counts and the misfit of the law.

Tactels that are declared dead or would be at full scale carry no information. Level ``full`` reaches the
bound where a contact moves several tactels; where it moves few, errors are not normal, the estimator's
prior helps, and the bound says only that the place is badly determined: ``holds`` is False there.

Failure: maps of residuals and widths of indenters are left out; several contacts at once have wider bounds.
Source: S. Kay, Fundamentals of Statistical Signal Processing I (1993), 3.9.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.ndimage import label

from skinbus.estimate.levels.merge import EVIDENCE
from skinbus.model import Arm, Cone, Law, Surface
from skinbus.model.mesh_surface import MeshSurface

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

FORCE: Final = 5.0
"""N, the contact that is bounded: a firm finger."""
STEP: Final = 2e-3
"""m, of the grid: a fifth of the usual pitch."""
_DIFFERENCE: Final = 1e-5
"""Of derivatives, m and relative force: wide against rounding, narrow against any contact."""
_NEAREST: Final = 12
"""Tactels that may register a light contact: of 16 around it the corners feel least."""
MOST_FORCE: Final = 1000.0
"""N; what needs more is not registered."""
_HALVINGS: Final = 30
"""Of the search for the least force: from a factor 1e6 to 3e-8 of it in the logarithm."""
FELT: Final = 4
"""Tactels beyond three standard deviations that a contact must move for the bound to hold: three determine
place and force, one more shows whether they do. They must surround the contact: beside all tactels that feel
it, weak and near is as likely as strong and far."""
TIP: Final = 1e-3
"""m, two of the largest standard deviations: so near a tactel the bound does not hold for a cone, whose tip
has no slope."""
SMALL: Final = 0.5e-3
"""m, standard deviation of a place up to which the bound holds: a law bends over a few millimetres."""
SMALLEST_AREA: Final = 1e-4
"""m^2, of bare areas that are named: a fingertip."""


BARE, NOWHERE = -1, -2
"""Boards of points that no board covers, and that are beside the mesh of a link."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Coverage:
    """Columns over the points of a grid on all links.

    link, s, a      (n,) where, m
    board           (n,) patch whose board covers the point, BARE for none, NOWHERE beside the mesh of a link
    least_force     (n,) N; infinite where nothing is registered
    sd_place        (n,) m, root of the sum of both variances; infinite where the place is not determined
    sd_force        (n,) N, the same of the force
    covariance      (n, 3, 3) the bound of s, a (m) and force (N); NaN where there is none
    holds           (n,) bool, whether an estimator may be expected to reach the bound
    area            (n,) m^2 that a point stands for
    """

    arm: Arm
    force: float
    link: Ints
    s: Floats
    a: Floats
    board: Ints
    least_force: Floats
    sd_place: Floats
    sd_force: Floats
    covariance: Floats
    holds: Bools
    area: Floats
    shapes: tuple[tuple[int, int], ...]
    """(n_links, 2) of the grid: along s and around."""

    def grid(self, link: int, column: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the values of a column on a link as a picture, (along s, around)."""
        return np.asarray(column[self.link == link].reshape(self.shapes[link]))


@dataclass(frozen=True, slots=True, kw_only=True)
class BareArea:
    """A connected area of a link without a board."""

    link: int
    area: float
    """m^2"""
    s: tuple[float, float]
    """From and to, m."""
    a: tuple[float, float]
    """From and to, m; beyond half a period where it goes across the back."""
    least_force: float
    """N, of its worst point; infinite where nothing is registered there."""


def cover(arm: Arm, *, force: float = FORCE, step: float = STEP) -> Coverage:
    """Return what the skin of an arm feels on a grid over all its links.

    force: of the contact that is bounded, N
    step:  of the grid, m
    """
    parts, shapes = [], []
    for link, part in enumerate(arm.links):
        s, a = _grid(part.surface, step)
        shapes.append((len(s), len(a)))
        ss, aa = (x.ravel() for x in np.meshgrid(s, a, indexing="ij"))
        if isinstance(part.surface, MeshSurface):
            stretch = part.surface.area_at(ss, aa)
        else:
            stretch = part.surface.radius_at(ss) / part.surface.radius
        area = part.surface.length * part.surface.width / ss.size * stretch
        parts.append((np.full(ss.size, link), ss, aa, area))
    link_of, s, a, area = (np.concatenate(column) for column in zip(*parts, strict=True))
    least, covariance, is_amid = at(arm, link_of, s, a, force)
    var_place = covariance[:, 0, 0] + covariance[:, 1, 1]
    sd_place = np.sqrt(np.where(np.isfinite(var_place), var_place, np.inf))
    sd_force = np.sqrt(np.where(np.isfinite(var_place), covariance[:, 2, 2], np.inf))
    return Coverage(
        arm=arm,
        force=force,
        link=link_of,
        s=s,
        a=a,
        board=_boards(arm, link_of, s, a),
        least_force=least,
        sd_place=sd_place,
        sd_force=sd_force,
        covariance=covariance,
        holds=is_amid & (sd_place <= SMALL),
        area=area,
        shapes=tuple(shapes),
    )


def at(arm: Arm, link: Ints, s: Floats, a: Floats, force: float) -> tuple[Floats, Floats, Bools]:
    """Return least forces (n,) N, bounds (n, 3, 3) and whether tactels that feel the contacts surround them.

    A bound is NaN where the readings do not determine place and force.
    """
    n = len(s)
    least, is_amid = np.full(n, np.inf), np.zeros(n, np.bool_)
    information = np.zeros((n, 3, 3))
    for points, tactels, surface in _neighbours(arm, link, s, a, force):
        if len(tactels):
            where = surface, s[points], a[points]
            information[points], is_amid[points] = _information(arm, *where, tactels, force)
            least[points] = _least_force(arm, *where, tactels)
    scale = np.sqrt(np.maximum(information.diagonal(axis1=1, axis2=2), 1e-300))
    scaled = information / (scale[:, :, None] * scale[:, None, :])
    determined = np.linalg.eigvalsh(scaled)[:, 0] > 1e-9
    covariance = np.full((n, 3, 3), np.nan)
    inverse = np.linalg.inv(scaled[determined])
    covariance[determined] = inverse / (scale[:, :, None] * scale[:, None, :])[determined]
    return least, covariance, is_amid


def bare_areas(coverage: Coverage) -> list[BareArea]:
    """Return the areas without a board that hold a fingertip, the largest first."""
    found = []
    for link, part in enumerate(coverage.arm.links):
        here = np.flatnonzero(coverage.link == link)
        shape, period = coverage.shapes[link], part.surface.period
        labels, n = label(coverage.board[here].reshape(shape) == BARE)
        if period:  # across the back, where the picture is cut
            for row in range(shape[0]):
                one, other = labels[row, 0], labels[row, -1]
                if one and other and one != other:
                    labels[labels == other] = one
        for number in range(1, n + 1):
            columns = np.nonzero(labels == number)[1]
            points = here[(labels == number).ravel()]
            area = float(coverage.area[points].sum())
            if area < SMALLEST_AREA:
                continue
            s, a = coverage.s[points], coverage.a[points]
            if period and len(set(columns)) < shape[1] and {0, shape[1] - 1} <= set(columns):
                a = np.where(a < a[_gap(columns, a)], a + period, a)
            half = 0.5 * part.surface.length / shape[0], 0.5 * part.surface.width / shape[1]
            extent = [(float(x.min()) - h, float(x.max()) + h) for x, h in zip((s, a), half, strict=True)]
            least = float(coverage.least_force[points].max())
            found.append(BareArea(link=link, area=area, s=extent[0], a=extent[1], least_force=least))
    return sorted(found, key=lambda bare: -bare.area)


def _gap(columns: npt.NDArray[np.intp], a: Floats) -> int:
    """Return a point of the first column behind the widest gap between columns."""
    used = np.unique(columns)
    first = used[int(np.argmax(np.diff(used))) + 1]
    return int(np.flatnonzero(columns == first)[0])


def _grid(surface: Surface, step: float) -> tuple[Floats, Floats]:
    """Return the middles of cells along s and around."""
    n = max(1, round(surface.length / step)), max(1, round(surface.width / step))
    s = (np.arange(n[0]) + 0.5) / n[0] * surface.length
    a = ((np.arange(n[1]) + 0.5) / n[1] - 0.5) * surface.width
    return s, a


def _boards(arm: Arm, link: Ints, s: Floats, a: Floats) -> Ints:
    """Return the patch whose board covers each point, BARE or NOWHERE, (n,)."""
    board = np.full(len(s), BARE, np.int64)
    for k, part in enumerate(arm.links):
        if isinstance(part.surface, MeshSurface):
            own = np.flatnonzero(link == k)
            board[own[~part.surface.contains(s[own], a[own])]] = NOWHERE
    for p, placed in enumerate(arm.patches):
        here = np.flatnonzero(link == placed.link)
        half = 0.5 * placed.scale * np.array(placed.patch.size)
        board[here[(np.abs(arm.on_board(p, s[here], a[here])) <= half).all(axis=-1)]] = p
    return board


def _neighbours(
    arm: Arm, link: Ints, s: Floats, a: Floats, force: float
) -> Iterator[tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Surface]]:
    """Yield points of a small area, the healthy tactels that a contact there may move, and the surface."""
    reach = max(float(np.max(p.patch.law.reach(max(force, 1.0)))) for p in arm.patches)
    reach = max(reach, 0.02) * float(max(1.0, arm.tactel_width.max()))
    tile = 0.04
    for k, part in enumerate(arm.links):
        here = np.flatnonzero(link == k)
        own = np.flatnonzero((arm.tactel_link == k) & arm.tactel_healthy)
        tiles = np.stack([np.floor(s[here] / tile), np.floor(a[here] / tile)], -1)
        _, group = np.unique(tiles, axis=0, return_inverse=True)
        for g in range(int(group.max(initial=-1)) + 1):
            points = here[group.ravel() == g]
            centre = float(s[points].mean()), float(a[points].mean())
            d = part.surface.distance(arm.tactel_s[own], arm.tactel_a[own], *centre)
            yield points, own[d <= reach + tile], part.surface


def _pressures(arm: Arm, surface: Surface, s: Floats, a: Floats, tactels: Any, force: Any) -> Floats:
    """Return what tactels read under contacts by their laws, (n, n_tactels) Pa; ``force`` (n or 1,) N."""
    distance = arm.distance(tactels, s, a) / arm.tactel_width[tactels]
    pressure = np.empty_like(distance)
    for law, columns in _laws(arm, tactels):
        pressure[:, columns] = law.pressure(distance[:, columns], np.reshape(force, (-1, 1)))
    return np.asarray(pressure)


def _laws(arm: Arm, tactels: npt.NDArray[np.intp]) -> Iterator[tuple[Law, npt.NDArray[np.intp]]]:
    laws = [arm.patches[p].patch.law for p in arm.tactel_patch[tactels]]
    for law in {id(law): law for law in laws}.values():
        yield law, np.flatnonzero([other is law for other in laws])


def _variance(
    arm: Arm, surface: Surface, s: Floats, a: Floats, tactels: Any, force: float, p: Floats
) -> Floats:
    """Return the variance of readings, (n, n_tactels) Pa^2: noise, rounding, and what the law leaves."""
    step = np.array([placed.patch.transducer.step for placed in arm.patches])[arm.tactel_patch[tactels]]
    step = step * arm.tactel_gain[tactels]
    variance = np.broadcast_to(arm.tactel_noise[tactels] ** 2 + step**2 / 12.0, p.shape).copy()
    for law, columns in _laws(arm, tactels):
        if isinstance(law, Cone) or law.misfit_profile is None:
            variance[:, columns] += (law.misfit * p[:, columns]) ** 2
            continue
        own = tactels[columns]
        d = arm.distance(own, s, a)
        at_table = np.arange(len(law.misfit_profile)) * law.step
        misfit = np.interp(d / arm.tactel_width[own], at_table, law.misfit_profile, right=0.0)
        variance[:, columns] += (force**law.exponent * misfit) ** 2
    return np.asarray(variance)


def _full_scale(arm: Arm, tactels: npt.NDArray[np.intp]) -> Floats:
    full = np.array([placed.patch.transducer.full_scale for placed in arm.patches])
    return np.asarray(full[arm.tactel_patch[tactels]] * arm.tactel_gain[tactels])


def _information(
    arm: Arm, surface: Surface, s: Floats, a: Floats, tactels: npt.NDArray[np.intp], force: float
) -> tuple[Floats, Bools]:
    """Return the Fisher information of (s, a, F), (n, 3, 3), and whether tactels that feel it surround it."""
    h = _DIFFERENCE

    def read(ds: float, da: float, df: float) -> Floats:
        return _pressures(arm, surface, s + ds, a + da, tactels, force * (1.0 + df))

    # bounds are in metres on the surface, not on the chart
    along, around = np.ones_like(s), surface.radius_at(s) / surface.radius
    if isinstance(surface, MeshSurface):
        area = surface.area_at(s, a)
        along = around = np.sqrt(np.where(area > 0.0, area, 1.0))
    slopes = [
        (read(h, 0.0, 0.0) - read(-h, 0.0, 0.0)) / (2.0 * h) / along[:, None],
        (read(0.0, h, 0.0) - read(0.0, -h, 0.0)) / (2.0 * h) / around[:, None],
        (read(0.0, 0.0, h) - read(0.0, 0.0, -h)) / (2.0 * h * force),
    ]
    p = read(0.0, 0.0, 0.0)
    variance = _variance(arm, surface, s, a, tactels, force, p)
    weight = np.where(p < _full_scale(arm, tactels), 1.0 / variance, 0.0)
    jacobian = np.stack(slopes, -1)
    felt = (p > 3.0 * np.sqrt(variance)) & (weight > 0.0)
    is_amid = (felt.sum(axis=1) >= FELT) & _surrounded(surface, s, a, arm, tactels, felt)
    for law, columns in _laws(arm, tactels):
        if isinstance(law, Cone):
            own = tactels[columns]
            d = arm.distance(own, s, a)
            is_amid &= (d > TIP).all(axis=1)
    return np.einsum("ntu,nt,ntv->nuv", jacobian, weight, jacobian), is_amid


def _surrounded(
    surface: Surface, s: Floats, a: Floats, arm: Arm, tactels: npt.NDArray[np.intp], felt: Bools
) -> Bools:
    """Return whether points are within the convex hull of the tactels that feel them, (n,)."""
    ds = arm.tactel_s[tactels] - s[:, None]
    da = surface.wrap(arm.tactel_a[tactels] - a[:, None])
    direction = np.sort(np.where(felt, np.arctan2(da, ds), np.nan), axis=1)  # NaN comes last
    last = np.take_along_axis(direction, np.maximum(felt.sum(axis=1) - 1, 0)[:, None], axis=1)
    gaps = np.nan_to_num(np.diff(direction, axis=1)).max(axis=1, initial=0.0)
    across = np.nan_to_num(direction[:, :1] + 2.0 * np.pi - last, nan=2.0 * np.pi)[:, 0]
    return np.asarray(np.maximum(gaps, across) <= np.pi + 1e-9)


def _least_force(arm: Arm, surface: Surface, s: Floats, a: Floats, tactels: npt.NDArray[np.intp]) -> Floats:
    """Return the least force that is registered, (n,) N; infinite where none is."""
    distance = arm.distance(tactels, s, a)
    nearest = np.argsort(distance, axis=1)[:, :_NEAREST]
    rows = np.arange(len(s))[:, None]
    distance = (distance / arm.tactel_width[tactels])[rows, nearest]
    step = np.array([placed.patch.transducer.step for placed in arm.patches])[arm.tactel_patch[tactels]]
    sigma = np.sqrt(arm.tactel_noise[tactels] ** 2 + (step * arm.tactel_gain[tactels]) ** 2 / 12.0)[nearest]
    threshold = arm.tactel_threshold[tactels][nearest]
    laws = [(law, np.isin(nearest, columns)) for law, columns in _laws(arm, tactels)]

    def registers(force: Floats) -> Bools:
        p = np.zeros_like(distance)
        for law, mask in laws:
            p[mask] = law.pressure(distance, force[:, None])[mask]
        touched = np.where(p >= threshold, p / sigma, 0.0)
        return np.asarray(((touched**2).sum(axis=1) >= EVIDENCE) & (touched > 0.0).any(axis=1))

    low, high = np.full(len(s), 1e-6 * MOST_FORCE), np.full(len(s), MOST_FORCE)
    ever = registers(high)
    for _ in range(_HALVINGS):
        middle = np.sqrt(low * high)
        is_enough = registers(middle)
        low, high = np.where(is_enough, low, middle), np.where(is_enough, middle, high)
    return np.where(ever, high, np.inf)
