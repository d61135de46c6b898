"""Loads: the normal force on patches, links and the arm as a sum of pressure times area, whatever presses.

::

    F = sum_j A_j p_j,   A_j = cell_j / (2 pi int_0^REACH k(d) d dd)

over touched tactels and those within REACH of them. The cell of a tactel is what is nearer to it than to any
other tactel, clipped to its board and half of the seam to the next one. The integral is the share of a press
that its board feels within REACH, by the law k of the board.

Standard deviation: noise, zeros and creep of the tactels that are summed, what the zeros of a board have in
common, and the error of the sum itself, a share of the force of each press::

    share^2 = SPREAD^2 + (c u)^2 + (H / F)^2 / 3
    c = sum_j F_j^2 / (sum_j F_j)^2,    u = max_j cell_j / min_j cell_j - 1

1 / c is the number of touched tactels that carry the press and u how uneven the cells of their board are: a
sum over few tactels depends on where between them the press is. H is the force that reaches the threshold of
a tactel from the farthest place of its cell, weighted by F_j^2: so much may press a gap and show little. On
4 x 4 tactels, 10 mm apart on boards of 50 mm, the deviation is about 60 % for a tip of 2 mm, 25 % for a thumb
and 7 % for a palm; on 8 x 8 it is 8 %, 3 % and 2 %. A tactel that is missing counts as the mean of its
neighbours, with that mean as its deviation.

Limits: pressures below every threshold are no load; a narrow press in a gap that tactels barely feel is
underestimated, beyond the deviation if its force is large; what hangs over the rim of the skin is not felt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from skinbus.estimate.baseline import Baseline
from skinbus.estimate.contacts import Contacts, Quality
from skinbus.estimate.kernels.layout import limit_of, step_of
from skinbus.estimate.validation import check_arm
from skinbus.model import Arm, Patch

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

REACH: Final = 35e-3
"""Distance within which a press is felt and tactels are summed, m. Under a layer of 6 mm, 4 % of its force
lie beyond 20 mm, and outer tactels of usual boards side by side are 21 mm apart."""
SEAM_MOST: Final = 5e-3
"""Boards that are this close share the seam between them, m."""
FINENESS: Final = 20
"""Points per pitch along each axis by which cells are measured."""
USUAL_N: Final = 5.0
"""Force at which the share that a board feels is integrated, N."""
NEXT: Final = 1.75
"""Tactels closer than so many sides of their cells are neighbours: diagonals, and those across a seam."""
BORDER: Final = 1.0 / 12.0
"""Variance of the share of a cell that is pressed at the border of a touch: anything from 0 to 1."""
HIDDEN_MOST: Final = 10.0
"""Force that a gap may hide, N, at most: where a law says that nothing is felt, it says no force."""
SPREAD: Final = 0.02
"""Error of the sum of a press on many tactels, share of the force: law and edges of boards."""
DIFFERENT: Final = 2.25
"""Standard deviations between load and contacts beyond which their forces do not add up."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadRows:
    """Loads of patches or links, (n,) each; zeros where nothing touches.

    force, force_sd   N
    s, a, place_sd    m, centre of pressure on the chart of the link; place_sd is along each axis, infinite
                      without a force
    area, area_sd     m^2, touched
    """

    force: Floats
    force_sd: Floats
    s: Floats
    a: Floats
    place_sd: Floats
    area: Floats
    area_sd: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loads:
    """The loads of one cycle."""

    patches: LoadRows
    links: LoadRows
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
        self.arm = arm
        self._variance = arm.tactel_noise**2 + step_of(arm) ** 2 / 12.0
        self._limit = np.asarray(limit_of(arm))
        self._cell, far = _cells(arm)
        shares = np.array([_felt_share(placed.patch) for placed in arm.patches])
        self.areas = self._cell / shares[arm.tactel_patch]
        """(n_tactels,) m^2, by which a pressure is multiplied."""
        felt = [
            placed.patch.law.pressure(far[arm.tactels_of(p)], USUAL_N) / USUAL_N
            for p, placed in enumerate(arm.patches)
        ]
        least = arm.tactel_threshold / HIDDEN_MOST
        self._hidden = arm.tactel_threshold / np.maximum(np.concatenate(felt), least)
        n_tactels = np.diff(arm.patch_start)
        self._spacing = np.sqrt(np.bincount(arm.tactel_patch, self._cell) / n_tactels)
        start = arm.patch_start[:-1]
        self._uneven = np.maximum.reduceat(self._cell, start) / np.minimum.reduceat(self._cell, start) - 1.0
        self._near, self._next = _neighbours(arm, np.sqrt(self._cell))
        self._reached = np.logical_or.reduceat(self._near, start, axis=1)  # (n_tactels, n_patches)
        self._root = np.arange(arm.n_patches)
        none = np.zeros(arm.n_tactels, np.bool_)
        self._nothing = self._sum(np.zeros(arm.n_tactels), none, ~none, None)

    def measure(
        self,
        pressures: Floats,
        touched: npt.ArrayLike,
        valid: npt.ArrayLike | None = None,
        *,
        baseline: Baseline | None = None,
    ) -> Loads:
        """Return the loads of one cycle.

        pressures: (n_tactels,) Pa, less the zeros; what is not finite is missing.
        touched:   (n_tactels,) not zero where something presses.
        valid:     (n_patches,) or (n_tactels,) False where a reading is missing; None for all there.
        baseline:  the one that has subtracted the zeros: their uncertainty is part of that of a load.

        Raises:
            ValueError: an array has the wrong shape.
        """
        arm = self.arm
        shape = (arm.n_tactels,)
        if np.shape(pressures) != shape or np.shape(touched) != shape:
            raise ValueError(f"pressures and touched must have shape {shape}")
        read = np.isfinite(pressures)
        if valid is not None:
            flags = np.asarray(valid, np.bool_)
            if flags.shape == (arm.n_patches,) != shape:
                flags = flags[arm.tactel_patch]
            if flags.shape != shape:
                raise ValueError(f"valid must have shape ({arm.n_patches},) or {shape}")
            read &= flags
        is_all_read = bool(read.all())
        read &= arm.tactel_healthy
        is_touched = (np.asarray(touched) != 0) & read
        if is_all_read and not is_touched.any():
            self._root = np.arange(arm.n_patches)
            return self._nothing
        return self._sum(np.where(read, pressures, 0.0), is_touched, read, baseline)

    def _sum(self, pressures: Floats, touched: Bools, read: Bools, baseline: Baseline | None) -> Loads:
        arm, n = self.arm, self.arm.n_patches
        (i,) = np.nonzero(self._near[touched].any(axis=0))  # only these count from here on
        patch, area, touched_here = arm.tactel_patch[i], self.areas[i], touched[i]
        value, variance, limit = pressures[i], self._variance[i], self._limit[i]
        common, creep = np.zeros(n), np.zeros(len(i))
        if baseline is not None:
            felt = baseline.felt
            variance = np.maximum(variance, felt.variance[i] + felt.doubt[i])
            limit, common, creep = limit - felt.zero[i], felt.common, felt.creep[i]
        at_least = np.bincount(arm.tactel_patch, read, n) == 0.0
        at_least[patch[read[i] & (value >= limit) & (limit > 0.0)]] = True
        for k in np.flatnonzero(~read[i]).tolist():
            beside = pressures[self._next[i[k]] & read]
            value[k] = beside.mean() if len(beside) else 0.0
            variance[k] = value[k] ** 2

        force, noise = area * value, area * area * variance
        of_patch = _by(patch, force, n)
        noise_of_patch = _by(patch, noise, n) + _by(patch, area * creep, n) ** 2
        noise_of_patch += common * _by(patch, area, n) ** 2
        root = self._root = self._join(touched)
        press = _by(root, of_patch, n)
        total = np.abs(press) + 1e-12
        carried2 = np.where(touched_here, force, 0.0) ** 2
        sum2 = _by(root[patch], carried2, n)
        hidden = _by(root[patch], carried2 * self._hidden[i], n) / np.maximum(sum2, 1e-12)
        share2 = SPREAD**2 + (sum2 / total**2 * self._uneven[root]) ** 2 + (hidden / total) ** 2 / 3.0

        touched_area = np.where(touched_here, self._cell[i], 0.0)
        is_border = np.zeros(arm.n_tactels, np.bool_)
        is_border[touched] = (self._next[touched] & ~touched).any(axis=1)
        columns = force, noise, touched_area, BORDER * is_border[i] * touched_area**2
        of_one = noise_of_patch + share2[root] * of_patch**2
        patches = self._rows(i, patch, n, columns, of_one, share2[root])
        link, m = arm.patch_link, len(arm.links)
        by_press = _by(link, share2 * press**2, m)
        of_link = np.maximum(np.abs(_by(link, of_patch, m)), 1e-12)
        of_many = _by(link, noise_of_patch, m) + by_press
        links = self._rows(i, arm.tactel_link[i], m, columns, of_many, by_press / of_link**2)
        return Loads(
            patches=patches,
            links=links,
            force=float(links.force.sum()),
            force_sd=math.sqrt((links.force_sd**2).sum()),
            area=float(links.area.sum()),
            area_sd=math.sqrt((links.area_sd**2).sum()),
            at_least=at_least,
        )

    def _rows(
        self,
        i: Ints,
        group: npt.NDArray[np.int32],
        n: int,
        columns: tuple[Floats, Floats, Floats, Floats],
        variance: Floats,
        share2: Floats,
    ) -> LoadRows:
        """Return the loads of n groups of tactels.

        i, group: (m,) tactels, and the group of each
        columns:  (m,) of their forces (N) and noise (N^2), touched areas (m^2) and their variance (m^4)
        variance: (n,) N^2, of the force of a group
        share2:   (n,) the square of the error of its sum, share of the force
        """
        arm = self.arm
        force, noise, area, area2 = columns
        total = _by(group, force, n)
        order = np.argsort(force, kind="stable")
        top = np.zeros(n, np.int64)
        top[group[order]] = i[order]  # of each group the strongest, which is written last
        x = arm.tactel_s[i] - arm.tactel_s[top][group]
        y = _around(arm.tactel_a[i] - arm.tactel_a[top][group], arm.link_period[arm.tactel_link[i]])
        known = total > 0.0
        weight = np.where(known, total, 1.0)
        s, a = _by(group, force * x, n) / weight, _by(group, force * y, n) / weight
        away2 = (x - s[group]) ** 2 + (y - a[group]) ** 2
        moment = np.maximum(_by(group, force * away2, n) / weight, 0.0)
        place2 = 0.5 * _by(group, noise * away2, n) / weight**2
        place2 += share2 * (0.25 * self._spacing[arm.tactel_patch[top]] ** 2 + moment)
        unknown = np.where(np.bincount(group, minlength=n) > 0, np.inf, 0.0)
        return LoadRows(
            force=total,
            force_sd=np.sqrt(variance),
            s=np.where(known, s + arm.tactel_s[top], 0.0),
            a=np.where(known, _around(a + arm.tactel_a[top], arm.link_period[arm.tactel_link[top]]), 0.0),
            place_sd=np.where(known, np.sqrt(place2), unknown),
            area=_by(group, area, n),
            area_sd=np.sqrt(_by(group, area2, n)),
        )

    def _join(self, touched: Bools) -> Ints:
        """Return for each patch the first one that the same press may reach, (n_patches,)."""
        patch, n = self.arm.tactel_patch, self.arm.n_patches
        together = np.eye(n, dtype=np.bool_)
        for p in np.unique(patch[touched]).tolist():
            together[p] |= self._reached[touched & (patch == p)].any(axis=0)
        together |= together.T
        root = np.arange(n)
        while True:
            lower = np.where(together, root, n).min(axis=1)
            if np.array_equal(lower, root):
                return root
            root = lower

    def flag_extended(self, contacts: Contacts, loads: Loads) -> None:
        """Set EXTENDED on contacts whose forces do not add up to the load, in place.

        ``loads`` are those measured last. Summed is over patches that one press may reach, where all contacts
        have a standard deviation: level ``kmeans`` has none.
        """
        if not len(contacts):
            return
        n, root = self.arm.n_patches, self._root
        press = root[contacts.patch]
        variance = contacts.covariance[:, 2, 2]
        unknown = np.bincount(press, variance <= 0.0, n) + np.bincount(root, loads.at_least, n)
        missing = np.bincount(root, loads.patches.force, n) - np.bincount(press, contacts.force, n)
        spread = np.bincount(root, loads.patches.force_sd, n) ** 2 + np.bincount(press, variance, n)
        extended = (unknown == 0.0) & (missing**2 > DIFFERENT**2 * spread)
        contacts.quality[extended[press]] |= Quality.EXTENDED


def _felt_share(patch: Patch) -> float:
    """Return the share of a press that tactels within REACH would feel if they left no gaps."""
    d = np.linspace(0.0, REACH, 200)
    share = float(np.trapezoid(2.0 * np.pi * d * patch.law.pressure(d, USUAL_N), d)) / USUAL_N
    return share if share > 0.0 else 1.0


def _by(group: npt.NDArray[Any], value: Floats, n: int) -> Floats:
    """Return the sums of values by group, (n,) float64 even where there is none."""
    return np.asarray(np.bincount(group, value, n), np.float64)


def _around(a: Floats, period: Floats) -> Floats:
    """Return distances or places around links, m, brought to half a turn; unchanged where there is none."""
    return np.asarray(a - period * np.rint(a / np.where(period > 0.0, period, np.inf)))


def _cells(arm: Arm) -> tuple[Floats, Floats]:
    """Return the area that is nearest to each tactel, m^2, and how far it reaches, m, (n_tactels,) each."""
    cell, far = np.zeros(arm.n_tactels), np.zeros(arm.n_tactels)
    half = np.array([0.5 * math.hypot(*placed.patch.size) for placed in arm.patches])
    for p, placed in enumerate(arm.patches):
        away = arm.links[placed.link].surface.distance(
            arm.patch_s[p], arm.patch_a[p], arm.patch_s, arm.patch_a
        )
        near = (arm.patch_link == placed.link) & (away <= half + half[p] + SEAM_MOST)
        near[p] = False
        step = placed.patch.pitch / FINENESS
        uv = np.stack(np.meshgrid(*(_across(side, step) for side in placed.patch.size)), -1).reshape(-1, 2)
        s, a = arm.on_link(p, uv)
        to_other = np.full(len(uv), np.inf)
        for q in np.flatnonzero(near).tolist():
            to_other = np.minimum(to_other, _distance_off(arm.patches[q].patch, arm.on_board(q, s, a)))
        off = _distance_off(placed.patch, uv)
        half_seam = np.clip(0.5 + 0.5 * (to_other - off) / step, 0.0, 1.0) * (off + to_other <= SEAM_MOST)
        weight = np.where(off == 0.0, 1.0, half_seam) * step * step
        d, nearest = cKDTree(placed.patch.tactels_uv).query(uv)
        cell[arm.tactels_of(p)] = np.bincount(nearest, weight, placed.patch.n_tactels)
        np.maximum.at(far, arm.patch_start[p] + nearest, np.where(weight > 0.0, d, 0.0))
    return np.maximum(cell, 1e-12), far  # one of two tactels in one place is nearest to nothing


def _across(side: float, step: float) -> Floats:
    """Return middles of steps across a board and half of the widest seams beside it, m."""
    n = math.ceil((side + SEAM_MOST) / (2.0 * step))
    return np.asarray(step * (np.arange(-n, n) + 0.5), np.float64)


def _distance_off(patch: Patch, uv: Floats) -> Floats:
    """Return how far places (n, 2) m are off a board along the farther axis, (n,) m."""
    off: Floats = np.maximum(np.abs(uv) - 0.5 * np.array(patch.size), 0.0).max(axis=-1)
    return off


def _neighbours(arm: Arm, side: Floats) -> tuple[Bools, Bools]:
    """Return which tactels are within REACH of each, itself among them, and which are next to it, (n, n)."""
    d = np.full((arm.n_tactels, arm.n_tactels), np.inf)
    for k, link in enumerate(arm.links):
        (i,) = np.nonzero(arm.tactel_link == k)
        s, a = arm.tactel_s[i], arm.tactel_a[i]
        d[np.ix_(i, i)] = link.surface.distance(s[:, None], a[:, None], s, a)
    beside = d <= 0.5 * NEXT * (side[:, None] + side)
    np.fill_diagonal(beside, False)
    return d <= REACH, beside
