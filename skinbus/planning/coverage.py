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

import numpy as np

from skinbus.arrays import Bools, Floats, Ints
from skinbus.estimate.levels.merge import EVIDENCE
from skinbus.model import Arm, Law
from skinbus.model.mesh_surface import MeshSurface

FORCE = 5.0
"""N, the contact that is bounded: a firm finger."""
STEP = 2e-3
"""m, of the grid: a fifth of the usual pitch."""
DIFFERENCE = 1e-5
"""Of derivatives, m and relative force: wide against rounding, narrow against any contact."""
FORCES = (1e-3, 1e3)
"""N, within which the least force is searched; what needs more is not registered."""
HALVINGS = 16
"""Of that search: to 3e-4 of the force."""
FELT = 4
"""Tactels beyond three standard deviations for the bound to hold: three determine place and force, one more
shows whether they do."""
NOTHING = np.array([1.0, 1.0, 1e-6])
"""Information that is always there: a contact is within a metre and a thousand newtons, 1/m^2 and 1/N^2."""
SMALL = 0.5e-3
"""m, standard deviation of a place up to which the bound holds: a law bends over a few millimetres."""

BARE, NOWHERE = -1, -2
"""Boards of points that no board covers, and that are beside the mesh of a link."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Coverage:
    """A grid over a link: columns (along s, around).

    s, a            where, m
    board           patch whose board covers the point, BARE for none, NOWHERE beside the mesh of the link
    area            m^2 that a point stands for; 0 beside the mesh
    least_force     N; infinite where nothing is registered
    sd_place        m, root of the sum of both variances; infinite where the place is not determined
    sd_force        N, the same of the force
    holds           whether an estimator may be expected to reach the bound
    """

    link: str
    step: tuple[float, float]
    """m, along s and around."""
    s: Floats
    a: Floats
    board: Ints
    area: Floats
    least_force: Floats
    sd_place: Floats
    sd_force: Floats
    holds: Bools


def cover(arm: Arm, *, force: float = FORCE, step: float = STEP) -> list[Coverage]:
    """Return what the skin of an arm feels on a grid over each of its links.

    Args:
        arm: its laws, noises and thresholds.
        force: of the contact that is bounded, N.
        step: of the grid, m.
    """
    return [_cover_link(arm, k, force, step) for k in range(len(arm.links))]


def _cover_link(arm: Arm, k: int, force: float, step: float) -> Coverage:
    surface = arm.links[k].surface
    shape = max(1, round(surface.length / step)), max(1, round(surface.width / step))
    rows, columns = ((np.arange(n) + 0.5) / n for n in shape)
    grid = np.meshgrid(rows * surface.length, (columns - 0.5) * surface.width, indexing="ij")
    s, a = (column.ravel() for column in grid)
    board = np.full(s.size, BARE)
    if isinstance(surface, MeshSurface):
        stretch = surface.area_at(s, a)
        along = around = np.sqrt(np.where(stretch > 0.0, stretch, 1.0))
        board[~surface.contains(s, a)] = NOWHERE
    else:
        along, around = np.ones_like(s), surface.radius_at(s) / surface.radius
        stretch = around
    information, n_felt, boards = np.zeros((s.size, 3, 3)), np.zeros(s.size, np.int64), []
    for p, placed in enumerate(arm.patches):
        if placed.link != k:
            continue
        patch = placed.patch
        half = 0.5 * placed.scale * np.array(patch.size)
        board[(np.abs(arm.on_board(p, s, a)) <= half).all(axis=-1)] = p
        tactels = np.flatnonzero((arm.tactel_patch == p) & arm.tactel_healthy)
        if not len(tactels):
            continue
        reach = max(0.02, float(patch.law.reach(max(force, 1.0)))) * max(1.0, arm.tactel_width[tactels].max())
        reach += 0.5 * math.hypot(*patch.size)
        i = np.flatnonzero(surface.distance(s, a, placed.s, placed.a) <= reach)
        rounding = patch.transducer.step * arm.tactel_gain[tactels]
        noise2 = arm.tactel_noise[tactels] ** 2 + rounding**2 / 12.0
        d, *beside = (
            arm.distance(tactels, s[i] + x / along[i], a[i] + y / around[i]) / arm.tactel_width[tactels]
            for x, y in DIFFERENCE * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])
        )
        p_felt, stronger = patch.law.pressure(d, force), patch.law.pressure(d, force * (1.0 + DIFFERENCE))
        east, west, north, south = (patch.law.pressure(away, force) for away in beside)
        changes = [0.5 * (east - west), 0.5 * (north - south), (stronger - p_felt) / force]
        slopes, misfit = np.stack(changes, -1) / DIFFERENCE, patch.law.unexplained(d, force)
        is_known = p_felt < patch.transducer.full_scale * arm.tactel_gain[tactels]
        weight = np.where(is_known, 1.0 / (noise2 + misfit**2), 0.0)
        information[i] += np.einsum("ntu,nt,ntv->nuv", slopes, weight, slopes)
        n_felt[i] += (p_felt**2 * weight > 9.0).sum(axis=1)
        boards.append((i, d, patch.law, arm.tactel_threshold[tactels], noise2))
    variance = np.linalg.inv(information + np.diag(NOTHING)).diagonal(axis1=1, axis2=2)
    # bounds that are those of one who knows nothing are none
    variance = np.where(variance * NOTHING > 0.01, np.inf, variance).T.reshape(3, *shape)
    sd_place = np.sqrt(variance[0] + variance[1])
    return Coverage(
        link=arm.links[k].name,
        step=(surface.length / shape[0], surface.width / shape[1]),
        s=grid[0],
        a=grid[1],
        board=board.reshape(shape),
        area=(surface.length * surface.width / s.size * stretch).reshape(shape),
        least_force=_least_force(boards, s.size).reshape(shape),
        sd_place=sd_place,
        sd_force=np.sqrt(variance[2]),
        holds=(n_felt.reshape(shape) >= FELT) & (sd_place <= SMALL),
    )


def _least_force(boards: list[tuple[Ints, Floats, Law, Floats, Floats]], n: int) -> Floats:
    """Return the least force that is registered at n points, N; infinite where none is."""

    def registers(force: Floats) -> Bools:
        evidence = np.zeros(n)
        for i, d, law, threshold, variance in boards:
            p = law.pressure(d, force[i, None])
            evidence[i] += np.where(p >= threshold, p**2 / variance, 0.0).sum(axis=1)
        return evidence >= EVIDENCE

    low, high = (np.full(n, end) for end in FORCES)
    ever = registers(high)
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        is_enough = registers(middle)
        low, high = np.where(is_enough, low, middle), np.where(is_enough, middle, high)
    return np.where(ever, high, np.inf)
