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

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.ndimage import find_objects, label

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
shows whether they do."""
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
    boards = []
    for p, placed in enumerate(arm.patches):
        tactels = np.flatnonzero((arm.tactel_patch == p) & arm.tactel_healthy)
        here = np.flatnonzero(link == placed.link)
        half = 0.5 * placed.scale * np.array(placed.patch.size)
        board[here[(np.abs(arm.on_board(p, s[here], a[here])) <= half).all(axis=-1)]] = p
        if len(tactels):
            reach = max(0.02, float(np.max(placed.patch.law.reach(max(force, 1.0)))))
            reach *= max(1.0, float(arm.tactel_width[tactels].max()))
            reach += 0.5 * math.hypot(*placed.patch.size)
            away = arm.links[placed.link].surface.distance(s[here], a[here], placed.s, placed.a)
            boards.append(_Board(arm, p, tactels, here[away <= reach], s, a))
    sd_place, sd_force, holds = _bounds(boards, force, np.stack([along, around], -1))
    return Coverage(
        arm=arm,
        force=force,
        link=link,
        s=s,
        a=a,
        board=board,
        area=area,
        least_force=_least_force(boards, len(s)),
        sd_place=sd_place,
        sd_force=sd_force,
        holds=holds,
        shapes=tuple(shapes),
    )


class _Board:
    """The healthy tactels of a board, and the points of the grid that they may feel."""

    def __init__(
        self, arm: Arm, patch: int, tactels: npt.NDArray[np.intp], points: npt.NDArray[np.intp], s: Floats,
        a: Floats,
    ) -> None:  # fmt: skip
        self.arm, self.patch, self.tactels, self.points = arm, arm.patches[patch].patch, tactels, points
        self.s, self.a = s[points], a[points]
        step = self.patch.transducer.step * arm.tactel_gain[tactels]
        self.variance = arm.tactel_noise[tactels] ** 2 + step**2 / 12.0
        """(n_tactels,) Pa^2, of noise and rounding."""

    def pressures(self, force: Floats | float, ds: Floats | float = 0.0, da: Floats | float = 0.0) -> Floats:
        """Return the pressures of contacts near the points, (n_points, n_tactels) Pa."""
        force = np.broadcast_to(force, self.s.shape)
        return np.asarray(self.patch.law.pressure(self.distance(ds, da), force[:, None]))

    def distance(self, ds: Floats | float = 0.0, da: Floats | float = 0.0) -> Floats:
        """Return distances over the widths of the tactels, (n_points, n_tactels) m."""
        return self.arm.distance(self.tactels, self.s + ds, self.a + da) / self.arm.tactel_width[self.tactels]

    def weights(self, force: float) -> tuple[Floats, Bools]:
        """Return the inverse variances of the readings, 1/Pa^2, and which tactels feel a contact."""
        law, p = self.patch.law, self.pressures(force)
        misfit = law.misfit * p
        if not isinstance(law, Cone) and law.misfit_profile is not None:
            at = np.arange(len(law.misfit_profile)) * law.step
            misfit = force**law.exponent * np.interp(self.distance(), at, law.misfit_profile, right=0.0)
        full = self.patch.transducer.full_scale * self.arm.tactel_gain[self.tactels]
        weight = np.where(p < full, 1.0 / (self.variance + misfit**2), 0.0)
        return weight, p * p * weight > 9.0


def _bounds(boards: list[_Board], force: float, stretch: Floats) -> tuple[Floats, Floats, Bools]:
    """Return the bounds on place (m) and force (N), infinite for none, and where they hold."""
    n, h = len(stretch), DIFFERENCE
    information, n_felt = np.zeros((n, 3, 3)), np.zeros(n, np.int64)
    for board in boards:
        i, (weight, felt) = board.points, board.weights(force)
        ds, da = (h / stretch[i]).T
        slopes = (
            board.pressures(force, ds) - board.pressures(force, -ds),
            board.pressures(force, 0.0, da) - board.pressures(force, 0.0, -da),
            (board.pressures(force * (1.0 + h)) - board.pressures(force * (1.0 - h))) / force,
        )
        jacobian = np.stack(slopes, -1) / (2.0 * h)
        information[i] += np.einsum("ntu,nt,ntv->nuv", jacobian, weight, jacobian)
        n_felt[i] += felt.sum(axis=1)
    scale = np.sqrt(np.maximum(information.diagonal(axis1=1, axis2=2), 1e-300))
    scaled = information / (scale[:, :, None] * scale[:, None, :])
    known = np.linalg.eigvalsh(scaled)[:, 0] > 1e-9
    variance = np.full(scale.shape, np.inf)
    variance[known] = np.linalg.inv(scaled[known]).diagonal(axis1=1, axis2=2) / scale[known] ** 2
    sd_place = np.sqrt(variance[:, 0] + variance[:, 1])
    holds = (n_felt >= FELT) & (sd_place <= SMALL)
    return sd_place, np.sqrt(variance[:, 2]), holds


def _least_force(boards: list[_Board], n: int) -> Floats:
    """Return the least force that is registered at n points, N; infinite where none is."""

    def registers(force: Floats) -> Bools:
        evidence = np.zeros(n)
        for board in boards:
            p = board.pressures(force[board.points])
            touched = p >= board.arm.tactel_threshold[board.tactels]
            evidence[board.points] += np.where(touched, p**2 / board.variance, 0.0).sum(axis=1)
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
        surface, bare = part.surface, coverage.grid(k, coverage.board) == BARE
        step_s, step_a = surface.length / bare.shape[0], surface.width / bare.shape[1]
        # a surface that closes is cut where it is bare least
        cut = int(bare.sum(axis=0).argmin()) if surface.period else 0
        labels, _ = label(np.roll(bare, -cut, axis=1))
        area = np.roll(coverage.grid(k, coverage.area), -cut, axis=1)
        least = np.roll(coverage.grid(k, coverage.least_force), -cut, axis=1)
        for number, (rows, columns) in enumerate(find_objects(labels), 1):
            own = labels == number
            ends = (step_a * (cut + column) - 0.5 * surface.width for column in (columns.start, columns.stop))
            if area[own].sum() >= SMALLEST_AREA:
                found.append(
                    BareArea(
                        link=k,
                        area=float(area[own].sum()),
                        s=(step_s * rows.start, step_s * rows.stop),
                        a=(next(ends), next(ends)),
                        least_force=float(least[own].max()),
                    )
                )
    return sorted(found, key=lambda bare: -bare.area)
