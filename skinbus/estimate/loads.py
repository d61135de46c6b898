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
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]
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
        self.arm = arm
        self._variance = arm.tactel_noise**2 + step_of(arm) ** 2 / 12.0
        self._limit, patch, start = np.asarray(limit_of(arm)), arm.tactel_patch, arm.patch_start[:-1]
        (self._cell, far), share, felt = _cells(arm), np.ones(arm.n_patches), np.zeros(arm.n_tactels)
        d = np.linspace(0.0, REACH, 200)
        for p, placed in enumerate(arm.patches):
            law, here = placed.patch.law, arm.tactels_of(p)
            share[p] = float(np.trapezoid(2.0 * np.pi * d * law.pressure(d, USUAL_N), d)) / USUAL_N
            felt[here] = law.pressure(far[here], USUAL_N) / USUAL_N
        self.areas = self._cell / np.where(share > 0.0, share, 1.0)[patch]
        """(n_tactels,) m^2, by which a pressure is multiplied."""
        self._hidden = arm.tactel_threshold / np.maximum(felt, arm.tactel_threshold / HIDDEN_MOST)
        self._uneven = np.maximum.reduceat(self._cell, start) / np.minimum.reduceat(self._cell, start) - 1.0
        away, side = np.full((arm.n_tactels, arm.n_tactels), np.inf), np.sqrt(self._cell)
        for k in range(len(arm.links)):
            (i,) = np.nonzero(arm.tactel_link == k)
            away[np.ix_(i, i)] = arm.links[k].surface.distance(
                arm.tactel_s[i, None], arm.tactel_a[i, None], arm.tactel_s[i], arm.tactel_a[i]
            )
        self._near = away <= REACH
        self._next = (away <= 0.5 * NEXT * (side[:, None] + side)) & ~np.eye(arm.n_tactels, dtype=np.bool_)
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
        arm, shape = self.arm, (self.arm.n_tactels,)
        if np.shape(pressures) != shape or np.shape(touched) != shape:
            raise ValueError(f"pressures and touched must have shape {shape}")
        flags = np.asarray(True if valid is None else valid, np.bool_)
        if flags.shape == (arm.n_patches,) != shape:
            flags = flags[arm.tactel_patch]
        if flags.shape not in ((), shape):
            raise ValueError(f"valid must have shape ({arm.n_patches},) or {shape}")
        read = np.isfinite(pressures) & flags
        is_touched = (np.asarray(touched) != 0) & read & arm.tactel_healthy
        if read.all() and not is_touched.any():
            self._root = np.arange(arm.n_patches)
            return self._nothing
        return self._sum(pressures, is_touched, read & arm.tactel_healthy, baseline)

    def _sum(self, pressures: Floats, touched: Bools, read: Bools, baseline: Baseline | None) -> Loads:
        arm, n, m = self.arm, self.arm.n_patches, len(self.arm.links)
        patch, link = arm.tactel_patch, arm.tactel_link
        counts = np.asarray(self._near[touched].any(axis=0))
        value, variance, limit = np.where(read, pressures, 0.0), self._variance, self._limit
        common, creep = np.zeros(n), np.zeros(arm.n_tactels)
        if baseline is not None:
            felt = baseline.felt
            variance = np.maximum(variance, felt.variance + felt.doubt)
            limit, common, creep = limit - felt.zero, felt.common, felt.creep
        full = read & counts & (value >= limit) & (limit > 0.0)
        at_least = (_sums(patch, read, n) == 0.0) | (_sums(patch, full, n) > 0.0)
        missing = np.flatnonzero(counts & ~read)
        if len(missing):
            beside = self._next[missing] & read
            value[missing] = beside @ value / np.maximum(beside.sum(axis=1), 1)
            variance = np.where(read, variance, value**2)

        area = np.where(counts, self.areas, 0.0)
        force, noise = area * value, area * area * variance
        of_patch = _sums(patch, force, n)
        noise_of_patch = _sums(patch, noise, n) + _sums(patch, area * creep, n) ** 2
        noise_of_patch += common * _sums(patch, area, n) ** 2
        root = self._root = self._join(touched)
        press = _sums(root, of_patch, n)
        carried2, force2 = (force * touched) ** 2, press**2 + 1e-24
        sum2 = _sums(root[patch], carried2, n)
        hidden = _sums(root[patch], carried2 * self._hidden, n) / np.maximum(sum2, 1e-12)
        share2 = SPREAD**2 + (sum2 / force2 * self._uneven[root]) ** 2 + hidden**2 / (3.0 * force2)

        pressed = self._cell * touched
        patches = LoadRows(
            force=of_patch,
            force_sd=np.sqrt(noise_of_patch + share2[root] * of_patch**2),
            area=_sums(patch, pressed, n),
        )
        border = np.asarray((self._next[touched] & ~touched).any(axis=1))
        by_press = _sums(arm.patch_link, share2 * press**2, m)
        of_link, variance = (
            _sums(link, force, m),
            _sums(arm.patch_link, noise_of_patch, m) + by_press,
        )
        s, a, place_sd = np.zeros(m), np.zeros(m), np.full(m, np.inf)
        place_sd[_sums(link, counts, m) == 0.0] = 0.0
        for k in np.flatnonzero(of_link > 0.0).tolist():
            (i,) = np.nonzero(counts & (link == k))
            top, weight, wrap = i[force[i].argmax()], force[i] / of_link[k], arm.links[k].surface.wrap
            x, y = arm.tactel_s[i] - arm.tactel_s[top], wrap(arm.tactel_a[i] - arm.tactel_a[top])
            s[k], a[k] = arm.tactel_s[top] + weight @ x, wrap(arm.tactel_a[top] + weight @ y)
            away2 = (x - weight @ x) ** 2 + (y - weight @ y) ** 2
            spacing2 = 0.25 * self._cell[patch == patch[top]].mean()
            own = 0.5 * noise[i] @ away2 + by_press[k] * (spacing2 + max(weight @ away2, 0.0))
            place_sd[k] = math.sqrt(own) / of_link[k]
        links = LinkLoads(
            force=of_link,
            force_sd=np.sqrt(variance),
            area=_sums(link, pressed, m),
            s=s,
            a=a,
            place_sd=place_sd,
        )
        return Loads(
            patches=patches,
            links=links,
            force=float(of_link.sum()),
            force_sd=math.sqrt(variance.sum()),
            area=float(pressed.sum()),
            area_sd=math.sqrt(BORDER * (border * self._cell[touched] ** 2).sum()),
            at_least=at_least,
        )

    def _join(self, touched: Bools) -> Ints:
        """Return for each patch the first one that the same press may reach, (n_patches,)."""
        patch, n = self.arm.tactel_patch, self.arm.n_patches
        together = np.eye(n, dtype=np.bool_)
        one, other = np.nonzero(self._near[touched])
        one = np.flatnonzero(touched)[one]
        together[patch[one], patch[other]] = together[patch[other], patch[one]] = True
        root = np.arange(n)
        while True:
            lower = np.where(together, root, n).min(axis=1)
            if np.array_equal(lower, root):
                return root
            root = lower

    def flag_extended(self, contacts: Contacts, loads: Loads) -> None:
        """Set EXTENDED on contacts whose forces do not add up to the load, in place.

        ``loads`` are those measured last. Summed is over patches that one press may reach, where all contacts
        have a standard deviation: level ``kmeans`` has none. That of a contact that misfits is no excuse.
        """
        if not len(contacts):
            return
        n, root = self.arm.n_patches, self._root
        press = root[contacts.patch]
        variance = contacts.covariance[:, 2, 2]
        unknown = np.bincount(press, variance <= 0.0, n) + np.bincount(root, loads.at_least, n)
        missing = np.bincount(root, loads.patches.force, n) - np.bincount(press, contacts.force, n)
        sure = np.where(contacts.quality & Quality.MISFIT, 0.0, variance)
        spread = np.bincount(root, loads.patches.force_sd, n) ** 2 + np.bincount(press, sure, n)
        extended = (unknown == 0.0) & (missing**2 > DIFFERENT**2 * spread)
        contacts.quality[extended[press]] |= Quality.EXTENDED


def _sums(group: npt.NDArray[Any], value: npt.NDArray[Any], n: int) -> Floats:
    """Return the sums of values by group, (n,) float64 even where there is none."""
    return np.asarray(np.bincount(group, value, n), np.float64)


def _cells(arm: Arm) -> tuple[Floats, Floats]:
    """Return the area that is nearest to each tactel, m^2, and how far it reaches, m, (n_tactels,) each."""
    cell, far = np.zeros(arm.n_tactels), np.zeros(arm.n_tactels)
    sizes = np.array([placed.patch.size for placed in arm.patches])
    half = 0.5 * np.hypot(*sizes.T)

    def off(p: int, uv: Floats) -> Floats:
        """Return how far places (n, 2) m are off a board along the farther axis, (n,) m."""
        return np.asarray(np.maximum(np.abs(uv) - 0.5 * sizes[p], 0.0).max(axis=-1))

    for p, placed in enumerate(arm.patches):
        away = arm.links[placed.link].surface.distance(placed.s, placed.a, arm.patch_s, arm.patch_a)
        near = (arm.patch_link == placed.link) & (away <= half + half[p] + SEAM_MOST)
        near[p] = False
        step = placed.patch.pitch / FINENESS
        sides = np.ceil((sizes[p] + SEAM_MOST) / (2.0 * step))
        uv = np.stack(np.meshgrid(*(step * (np.arange(-n, n) + 0.5) for n in sides)), -1).reshape(-1, 2)
        s, a = arm.on_link(p, uv)
        own, other = off(p, uv), np.full(len(uv), np.inf)
        for q in np.flatnonzero(near).tolist():
            other = np.minimum(other, off(q, arm.on_board(q, s, a)))
        # of a seam a board has the nearer half, to the fraction of a step
        seam = np.clip(0.5 + 0.5 * (other - own) / step, 0.0, 1.0) * (own + other <= SEAM_MOST)
        d, nearest = cKDTree(placed.patch.tactels_uv).query(uv)
        weight = step * step * np.where(own == 0.0, 1.0, seam)
        cell[arm.tactels_of(p)] = np.bincount(nearest, weight, placed.patch.n_tactels)
        np.maximum.at(far, arm.patch_start[p] + nearest, np.where(weight > 0.0, d, 0.0))
    return np.maximum(cell, 1e-12), far  # one of two tactels in one place is nearest to nothing
