"""Loads: the normal force on patches, links and the arm as a sum of pressure times area, whatever presses.

::

    F = sum_j A_j p_j,   A_j = cell_j / (2 pi int_0^REACH k(d) d dd)

over touched tactels and those within REACH of them. The cell of a tactel is what is nearer to it than to any
other tactel, clipped to its board and half of the seam to the next one. The integral is the share of a press
that its board feels within REACH, by the law k of the board.

Standard deviation: noise, zeros and creep of the tactels that are summed, what the zeros of a board have in
common, and the error of the sum itself, for each board a share of its force::

    share^2 = SPREAD^2 + u^2 c^3 + (H / F)^2 / 3
    c = sum_j F_j^2 / (sum_j F_j)^2,    u = max_j cell_j / min_j cell_j - 1

1 / c is the number of touched tactels that carry the force and u how uneven the cells of the board are: a sum
over few tactels depends on where between them the press is. H is the force that reaches the threshold of a
tactel from the farthest place of its cell, the mean over the board: so much may press on a gap and show
little. A tactel that is missing counts as the mean of its neighbours, with that mean as its deviation.

Limits: pressures below every threshold are no load; a narrow press in a gap that tactels barely feel is
underestimated, beyond the deviation if its force is large; what hangs over the rim of the skin is not felt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array, vstack
from scipy.spatial import cKDTree

from skinbus.arrays import Bools, Floats
from skinbus.estimate.baseline import Baseline, near_patches
from skinbus.estimate.contacts import Contacts, Quality
from skinbus.estimate.kernels.layout import SEAM, limit_of, step_of
from skinbus.model import Arm, Patch
from skinbus.model.validation import check_arm, check_fresh

REACH = 35e-3
"""Distance within which a press is felt and tactels are summed, m. Under a layer of 6 mm, 4 % of its force
lie beyond 20 mm, and outer tactels of usual boards side by side are 21 mm apart."""
FINENESS = 20
"""Points per pitch along each axis by which cells are measured."""
USUAL_N = 5.0
"""Force at which the share that a board feels is integrated, N."""
NEXT = 1.75
"""Tactels closer than so many sides of their cells are neighbours, also diagonally and across a seam."""
HIDDEN_MOST = 10.0
"""Most force that a gap may hide, N: also where the law says that nothing is felt."""
SPREAD = 0.02
"""Error of the sum of a press on many tactels, share of the force: law and edges of boards."""
DIFFERENT = 2.25
"""Load and forces of contacts that differ by more standard deviations do not add up."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadRows:
    """Loads of patches or links, (n,) each; zeros where nothing touches.

    force, force_sd  N
    area             m^2, touched
    """

    force: Floats
    force_sd: Floats
    area: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinkLoads(LoadRows):
    """Loads of links with their centres of pressure.

    s, a, place_sd  m, on the chart of the link; place_sd is along each axis, infinite without a force
    """

    s: Floats
    a: Floats
    place_sd: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loads:
    """The loads of one cycle."""

    patches: LoadRows
    links: LinkLoads
    force: float
    """N, of the arm."""
    force_sd: float
    area: float
    """m^2, of the arm."""
    area_sd: float
    at_least: Bools
    """(n_patches,) a tactel is at full scale, or none of the patch is read: the load may be larger."""


class LoadMeter:
    """Sums the pressures of an arm; cells and neighbours are found once."""

    def __init__(self, arm: Arm) -> None:
        check_arm(arm)
        self.arm, n = arm, arm.n_tactels
        self._variance, self._limit = arm.tactel_noise**2 + step_of(arm) ** 2 / 12.0, limit_of(arm)
        self._cell, self.areas = np.zeros((2, n))
        """The last, m^2, is by what a pressure is multiplied."""
        self._uneven, self._hidden = np.zeros((2, arm.n_patches))
        d, near = np.linspace(0.0, REACH, 200), near_patches(arm, REACH)
        for p, placed in enumerate(arm.patches):
            law, least, here = placed.patch.law, placed.patch.threshold, arm.tactels_of(p)
            cell, far = _cells(arm, p, near[p])
            self._cell[here] = cell
            share = float(np.trapezoid(2.0 * np.pi * d * law.pressure(d, USUAL_N), d)) / USUAL_N
            felt = law.pressure(far, USUAL_N) / USUAL_N
            self._uneven[p] = cell.max() / cell.min() - 1.0
            self._hidden[p] = np.mean(least / np.maximum(felt, least / HIDDEN_MOST))
            self.areas[here] = cell / (share if share > 0.0 else 1.0)
        self._near, self._next = _pairs(arm, near, self._cell)
        none = np.zeros(n, np.bool_)
        self._nothing = self._sum(np.zeros(n), none, ~none, None)

    def measure(
        self,
        pressures: Floats,
        touched: npt.ArrayLike,
        fresh: npt.ArrayLike | None = None,
        *,
        baseline: Baseline | None = None,
    ) -> Loads:
        """Return the loads of one cycle.

        pressures: (n_tactels,) Pa, less the zeros; what is not finite is missing.
        touched:   (n_tactels,) not zero where something presses.
        fresh:     (n_patches,) False where readings are missing; None for all there.
        baseline:  the one that has subtracted the zeros: their uncertainty is part of that of a load.

        Raises:
            ValueError: an array has the wrong shape.
        """
        arm, shape = self.arm, (self.arm.n_tactels,)
        if np.shape(pressures) != shape or np.shape(touched) != shape:
            raise ValueError(f"pressures and touched must have shape {shape}")
        read = np.isfinite(pressures) & check_fresh(arm, fresh)[arm.tactel_patch]
        is_touched = (np.asarray(touched) != 0) & read & arm.tactel_healthy
        if read.all() and not is_touched.any():
            return self._nothing
        return self._sum(pressures, is_touched, read & arm.tactel_healthy, baseline)

    def _sum(self, pressures: Floats, touched: Bools, read: Bools, baseline: Baseline | None) -> Loads:
        arm, n, m = self.arm, self.arm.n_patches, len(self.arm.links)
        patch, link = arm.tactel_patch, arm.tactel_link
        counts, value = self._near @ touched > 0.0, np.where(read, pressures, 0.0)
        variance, limit, common, creep = self._variance, self._limit, np.zeros(n), np.zeros(arm.n_tactels)
        if baseline is not None:
            felt = baseline.felt
            variance = np.maximum(variance, felt.variance + felt.doubt)
            limit, common, creep = limit - felt.zero, baseline.common, felt.creep
        full = read & counts & (value >= limit) & (limit > 0.0)
        if (counts & ~read).any():
            beside, n_beside = (self._next @ np.stack([value, read], -1)).T
            value = np.where(read, value, beside / np.maximum(n_beside, 1.0))
            variance = np.where(read, variance, value**2)

        area, pressed = np.where(counts, self.areas, 0.0), self._cell * touched
        force, noise = area * value, area * area * variance
        of_patch, of_link = _sums(patch, force, n), _sums(link, force, m)
        c = _sums(patch, (force * touched) ** 2, n) / (of_patch**2 + 1e-24)
        error = of_patch**2 * (SPREAD**2 + self._uneven**2 * c**3) + (c > 0.0) * self._hidden**2 / 3.0
        own = (
            _sums(patch, noise, n) + _sums(patch, area * creep, n) ** 2 + common * _sums(patch, area, n) ** 2
        )
        variance_of_link = _sums(arm.patch_link, own + error, m)
        s, a, place_sd = np.zeros((3, m))
        for k in np.flatnonzero(of_link > 0.0).tolist():
            (i,) = np.nonzero(counts & (link == k))
            top, weight, wrap = i[force[i].argmax()], force[i] / of_link[k], arm.links[k].surface.wrap
            x, y = arm.tactel_s[i] - arm.tactel_s[top], wrap(arm.tactel_a[i] - arm.tactel_a[top])
            s[k], a[k] = arm.tactel_s[top] + weight @ x, wrap(arm.tactel_a[top] + weight @ y)
            away2 = (x - weight @ x) ** 2 + (y - weight @ y) ** 2
            spread2 = 0.25 * self._cell[top] + max(weight @ away2, 0.0)
            place_sd[k] = math.sqrt(variance_of_link[k] * spread2) / of_link[k]
        return Loads(
            patches=LoadRows(force=of_patch, force_sd=np.sqrt(own + error), area=_sums(patch, pressed, n)),
            links=LinkLoads(
                force=of_link,
                force_sd=np.sqrt(variance_of_link),
                area=_sums(link, pressed, m),
                s=s,
                a=a,
                place_sd=place_sd,
            ),
            force=float(of_link.sum()),
            force_sd=math.sqrt(variance_of_link.sum()),
            area=float(pressed.sum()),
            # anything from none to all of a cell at the border of a touch is pressed
            area_sd=math.sqrt(((self._next @ ~touched > 0.0) * pressed**2).sum() / 12.0),
            at_least=(_sums(patch, read, n) == 0.0) | (_sums(patch, full, n) > 0.0),
        )

    def flag_extended(self, contacts: Contacts, loads: Loads) -> None:
        """Set EXTENDED on the contacts of links whose forces do not add up to the load, in place.

        Nothing is said where a contact has no standard deviation, as at level ``kmeans``, nor of a load that
        may be larger, up to the forces. The deviation of a contact that misfits is no excuse.
        """
        link, m, variance = contacts.link, len(self.arm.links), contacts.covariance[:, 2, 2]
        sure = np.where(contacts.quality & Quality.MISFIT.value, 0.0, variance)
        more = loads.links.force - _sums(link, contacts.force, m)
        spread = loads.links.force_sd**2 + _sums(link, sure, m)
        open_ended = (_sums(self.arm.patch_link, loads.at_least, m) > 0.0) & (more < 0.0)
        unknown = open_ended | (_sums(link, variance <= 0.0, m) > 0.0)
        extended = ~unknown & (more**2 > DIFFERENT**2 * spread)
        contacts.quality[extended[link]] |= Quality.EXTENDED


def _sums(group: npt.NDArray[Any], value: npt.NDArray[Any], n: int) -> Floats:
    """Return the sums of values by group, (n,) float64 even where there is none."""
    return np.bincount(group, value, n).astype(np.float64)


def _pairs(arm: Arm, near: Bools, cell: Floats) -> list[Any]:
    """Return which tactels are within REACH, and which are neighbours: (n_tactels, n_tactels), sparse."""
    side = 0.5 * NEXT * np.sqrt(cell)
    rows: tuple[list[Any], list[Any]] = [], []
    for p, beside in enumerate(near[:, arm.tactel_patch]):
        here, s, a = arm.tactels_of(p), arm.tactel_s, arm.tactel_a
        surface = arm.links[arm.patch_link[p]].surface
        d = np.full((arm.patches[p].patch.n_tactels, arm.n_tactels), np.inf)
        d[:, beside] = surface.distance(s[here, None], a[here, None], s[beside], a[beside])
        for row, is_pair in zip(rows, (d <= REACH, d <= side[here, None] + side), strict=True):
            row.append(csr_array(is_pair, dtype=np.float64))
    return [vstack(row) for row in rows]


def _cells(arm: Arm, p: int, near: Bools) -> tuple[Floats, Floats]:
    """Return the area that is nearest to each tactel of a board, m^2, and how far it reaches, m."""
    patch = arm.patches[p].patch
    uv, d, nearest = _grid(patch)
    s, a = arm.on_link(p, uv)
    step = patch.pitch / FINENESS
    own, weight = _off(arm, p, s, a), np.full(len(uv), step * step)
    rim = own > 0.0
    others = [_off(arm, q, s[rim], a[rim]) for q in np.flatnonzero(near).tolist() if q != p]
    own, other = own[rim], np.min(others, axis=0, initial=np.inf)
    # of a seam a board has the nearer half, to the fraction of a step
    weight[rim] *= np.clip(0.5 + 0.5 * (other - own) / step, 0.0, 1.0) * (own + other <= SEAM)
    far = np.zeros(patch.n_tactels)
    np.maximum.at(far, nearest, np.where(weight > 0.0, d, 0.0))
    # one of two tactels in one place is nearest to nothing
    return np.maximum(np.bincount(nearest, weight, patch.n_tactels), 1e-12), far


@lru_cache(maxsize=4)
def _grid(patch: Patch) -> Any:
    """Return points on a board and the seam around it, (n, 2) m, how far each is from a tactel, and which."""
    step = patch.pitch / FINENESS
    sides = [math.ceil((side + SEAM) / (2.0 * step)) for side in patch.size]
    uv = np.stack(np.meshgrid(*(step * (np.arange(-n, n) + 0.5) for n in sides)), -1).reshape(-1, 2)
    return uv, *cKDTree(patch.tactels_uv).query(uv)


def _off(arm: Arm, p: int, s: Floats, a: Floats) -> Any:
    """Return how far places are off a board along the farther axis, m."""
    u, v = (np.abs(arm.on_board(p, s, a)) - 0.5 * np.array(arm.patches[p].patch.size)).T
    return np.maximum(np.maximum(u, v), 0.0)
