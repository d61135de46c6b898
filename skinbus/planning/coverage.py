"""What a skin can feel where: the least force that is registered, and the bound on place and force.

For each point of the links' surfaces, from the laws, noises and thresholds that the boards declare:

* the least force that level ``kmeans`` registers if readings had no noise: tactels from their threshold on
  count, and their sum of (p / sigma)^2 must reach the evidence that makes a contact;
* the Cramer-Rao bound of place and force of a contact alone, J' V^-1 J inverted with J = dp / d(s, a, F) and
  V the variance of a reading: noise, rounding of counts and the misfit of the law.

Tactels that are declared dead or would be at full scale carry no information. Level ``full`` reaches the
bound where a contact moves several tactels around it; elsewhere ``holds`` is False.

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
from skinbus.model import Arm, Cone
from skinbus.model.mesh_surface import MeshSurface

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

FORCE: Final = 5.0
"""N, the contact that is bounded: a firm finger."""
STEP: Final = 2e-3
"""m, of the grid: a fifth of the usual pitch."""
DIFFERENCE: Final = 1e-5
"""Of derivatives, m and relative force: wide against rounding, narrow against any contact."""
FORCES: Final = (1e-3, 1e3)
"""N, within which the least force is searched; what needs more is not registered."""
HALVINGS: Final = 16
"""Of that search: to 3e-4 of the force."""
FELT: Final = 4
"""Tactels beyond three standard deviations for the bound to hold: three determine place and force, one more
shows whether they do. They must surround the contact."""
SECTORS: Final = 36
"""Of the directions in which tactels that feel a contact are looked for."""
TIP: Final = 1e-3
"""m; so near a tactel the bound does not hold for a cone, whose tip has no slope."""
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
    area            (n,) m^2 that a point stands for
    least_force     (n,) N; infinite where nothing is registered
    sd_place        (n,) m, root of the sum of both variances; infinite where the place is not determined
    sd_force        (n,) N, the same of the force
    holds           (n,) whether an estimator may be expected to reach the bound
    """

    arm: Arm
    force: float
    link: Ints
    s: Floats
    a: Floats
    board: Ints
    area: Floats
    least_force: Floats
    sd_place: Floats
    sd_force: Floats
    holds: Bools
    shapes: tuple[tuple[int, int], ...]
    """(n_links, 2) of the grid: along s and around."""

    def grid(self, link: int, column: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the values of a column on a link as a picture, (along s, around)."""
        return np.asarray(column[self.link == link].reshape(self.shapes[link]))


@dataclass(frozen=True, slots=True, kw_only=True)
class BareArea:
    """A connected area of a link without a board; ``s`` and ``a`` are from and to, m."""

    link: int
    area: float
    """m^2"""
    s: tuple[float, float]
    a: tuple[float, float]
    """Beyond half a period where it goes across the back."""
    least_force: float
    """N, of its worst point; infinite where nothing is registered there."""


def cover(arm: Arm, *, force: float = FORCE, step: float = STEP) -> Coverage:
    """Return what the skin of an arm feels on a grid over all its links.

    Args:
        arm: its laws, noises and thresholds.
        force: of the contact that is bounded, N.
        step: of the grid, m.
    """
    parts, shapes = [], []
    for k, part in enumerate(arm.links):
        surface = part.surface
        n = max(1, round(surface.length / step)), max(1, round(surface.width / step))
        shapes.append(n)
        s = np.repeat((np.arange(n[0]) + 0.5) / n[0] * surface.length, n[1])
        a = np.tile(((np.arange(n[1]) + 0.5) / n[1] - 0.5) * surface.width, n[0])
        board = np.full(s.size, BARE)
        if isinstance(surface, MeshSurface):
            stretch = surface.area_at(s, a)
            along = around = np.sqrt(np.where(stretch > 0.0, stretch, 1.0))
            board[~surface.contains(s, a)] = NOWHERE
        else:
            around = stretch = surface.radius_at(s) / surface.radius
            along = np.ones_like(s)
        area = surface.length * surface.width / s.size * stretch
        parts.append((np.full(s.size, k), s, a, board, area, along, around))
    link, s, a, board, area, along, around = (np.concatenate(column) for column in zip(*parts, strict=True))
    for p, placed in enumerate(arm.patches):
        here = np.flatnonzero(link == placed.link)
        half = 0.5 * placed.scale * np.array(placed.patch.size)
        board[here[(np.abs(arm.on_board(p, s[here], a[here])) <= half).all(axis=-1)]] = p
    near = list(_near(arm, link, s, a, force))
    information, surrounded = _information(arm, s, a, np.stack([along, around], -1), near, force)
    sd_place, sd_force = _standard_deviations(information)
    return Coverage(
        arm=arm,
        force=force,
        link=link,
        s=s,
        a=a,
        board=board,
        area=area,
        least_force=_least_force(arm, len(s), near),
        sd_place=sd_place,
        sd_force=sd_force,
        holds=surrounded & (sd_place <= SMALL),
        shapes=tuple(shapes),
    )


@dataclass(frozen=True, slots=True)
class _Near:
    """Points that a board may feel, its healthy tactels, and what all of them have in common."""

    patch: int
    points: npt.NDArray[np.intp]
    tactels: npt.NDArray[np.intp]
    distance: Floats
    """(n_points, n_tactels) m, over the width of the tactel."""
    variance: Floats
    """Of noise and rounding, (n_tactels,) Pa^2."""


def _near(arm: Arm, link: Ints, s: Floats, a: Floats, force: float) -> Iterator[_Near]:
    for p, placed in enumerate(arm.patches):
        tactels = np.flatnonzero((arm.tactel_patch == p) & arm.tactel_healthy)
        here = np.flatnonzero(link == placed.link)
        if not len(tactels):
            continue
        reach = max(0.02, float(np.max(placed.patch.law.reach(max(force, 1.0)))))
        reach = max(reach * float(arm.tactel_width[tactels].max()), reach) + 0.5 * np.hypot(
            *placed.patch.size
        )
        away = arm.links[placed.link].surface.distance(s[here], a[here], placed.s, placed.a)
        points = here[away <= reach]
        distance = arm.distance(tactels, s[points], a[points]) / arm.tactel_width[tactels]
        step = placed.patch.transducer.step * arm.tactel_gain[tactels]
        yield _Near(p, points, tactels, distance, arm.tactel_noise[tactels] ** 2 + step**2 / 12.0)


def _information(
    arm: Arm, s: Floats, a: Floats, stretch: Floats, near: list[_Near], force: float
) -> tuple[Floats, Bools]:
    """Return the Fisher information of (s, a, F), (n, 3, 3), and whether what feels a point surrounds it."""
    information, sectors = np.zeros((len(s), 3, 3)), np.zeros((len(s), SECTORS), np.bool_)
    n_felt, is_tip = np.zeros(len(s), np.int64), np.zeros(len(s), np.bool_)
    h = DIFFERENCE
    for one in near:
        law, i = arm.patches[one.patch].patch.law, one.points
        here, p = (s[i], a[i]), np.asarray(law.pressure(one.distance, np.full((1, 1), force)))
        if isinstance(law, Cone) or law.misfit_profile is None:
            misfit = law.misfit * p
        else:
            at = np.arange(len(law.misfit_profile)) * law.step
            misfit = force**law.exponent * np.interp(one.distance, at, law.misfit_profile, right=0.0)
        variance = one.variance + misfit**2
        full = arm.patches[one.patch].patch.transducer.full_scale * arm.tactel_gain[one.tactels]
        weight = np.where(p < full, 1.0 / variance, 0.0)
        jacobian = np.stack(
            [
                _slope(arm, one, here, force, (h, 0.0, 0.0)) / (2.0 * h * stretch[i, :1]),
                _slope(arm, one, here, force, (0.0, h, 0.0)) / (2.0 * h * stretch[i, 1:]),
                _slope(arm, one, here, force, (0.0, 0.0, h)) / (2.0 * h * force),
            ],
            -1,
        )
        information[i] += np.einsum("ntu,nt,ntv->nuv", jacobian, weight, jacobian)
        felt = (p * p * weight > 9.0) & (weight > 0.0)
        n_felt[i] += felt.sum(axis=1)
        surface = arm.links[arm.patches[one.patch].link].surface
        direction = np.arctan2(
            surface.wrap(arm.tactel_a[one.tactels] - a[i, None]), arm.tactel_s[one.tactels] - s[i, None]
        )
        row, column = np.nonzero(felt)
        sectors[i[row], (direction[row, column] * SECTORS / (2.0 * np.pi)).astype(np.int64) % SECTORS] = True
        is_tip[i] |= isinstance(law, Cone) & (one.distance < TIP).any(axis=1)
    # within the hull of what feels it: in every half of the directions there is one
    halves = [np.roll(sectors, -k, axis=1) for k in range(SECTORS // 2)]
    return information, np.any(halves, axis=0).all(axis=1) & (n_felt >= FELT) & ~is_tip


def _slope(
    arm: Arm, one: _Near, here: tuple[Floats, Floats], force: float, step: tuple[float, float, float]
) -> Floats:
    """Return the difference of pressures a step ahead of and a step behind a contact."""
    law, pressures = arm.patches[one.patch].patch.law, []
    for sign in (1.0, -1.0):
        s, a = here[0] + sign * step[0], here[1] + sign * step[1]
        distance = arm.distance(one.tactels, s, a) / arm.tactel_width[one.tactels]
        pressures.append(law.pressure(distance, np.full((1, 1), force * (1.0 + sign * step[2]))))
    return np.asarray(pressures[0] - pressures[1])


def _standard_deviations(information: Floats) -> tuple[Floats, Floats]:
    """Return those of place (m) and force (N) at the bound, (n,); infinite where they are not determined."""
    scale = np.sqrt(np.maximum(information.diagonal(axis1=1, axis2=2), 1e-300))
    scaled = information / (scale[:, :, None] * scale[:, None, :])
    known = np.linalg.eigvalsh(scaled)[:, 0] > 1e-9
    variance = np.full(scale.shape, np.inf)
    variance[known] = np.linalg.inv(scaled[known]).diagonal(axis1=1, axis2=2) / scale[known] ** 2
    return np.sqrt(variance[:, 0] + variance[:, 1]), np.sqrt(variance[:, 2])


def _least_force(arm: Arm, n: int, near: list[_Near]) -> Floats:
    """Return the least force that is registered at n points, N; infinite where none is."""

    def registers(force: Floats) -> Bools:
        evidence = np.zeros(n)
        for one in near:
            p = arm.patches[one.patch].patch.law.pressure(one.distance, force[one.points, None])
            touched = p >= arm.tactel_threshold[one.tactels]
            evidence[one.points] += np.where(touched, p**2 / one.variance, 0.0).sum(axis=1)
        return np.asarray(evidence >= EVIDENCE)

    low, high = (np.full(n, end) for end in FORCES)
    ever = registers(high)
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        is_enough = registers(middle)
        low, high = np.where(is_enough, low, middle), np.where(is_enough, middle, high)
    return np.where(ever, high, np.inf)


def bare_areas(coverage: Coverage) -> list[BareArea]:
    """Return the areas without a board that hold a fingertip, the largest first."""
    found = []
    for k, part in enumerate(coverage.arm.links):
        period, (_, n_around) = part.surface.period, coverage.shapes[k]
        labels, n = label(coverage.grid(k, coverage.board) == BARE)
        for one, other in labels[:, [0, -1]] if period else ():  # across the back, where the grid is cut
            if one and other:
                labels[labels == other] = one
        s, a, area, least = (
            coverage.grid(k, column)
            for column in (coverage.s, coverage.a, coverage.area, coverage.least_force)
        )
        half_s, half_a = 0.5 * part.surface.length / len(labels), 0.5 * part.surface.width / n_around
        for number in range(1, n + 1):
            own = labels == number
            if area[own].sum() < SMALLEST_AREA:
                continue
            unused = np.flatnonzero(~own.any(axis=0))
            cut = unused[0] if period and len(unused) else 0
            around = np.where(np.arange(n_around) < cut, a + (period or 0.0), a)[own]
            found.append(
                BareArea(
                    link=k,
                    area=float(area[own].sum()),
                    s=(float(s[own].min()) - half_s, float(s[own].max()) + half_s),
                    a=(float(around.min()) - half_a, float(around.max()) + half_a),
                    least_force=float(least[own].max()),
                )
            )
    return sorted(found, key=lambda bare: -bare.area)
