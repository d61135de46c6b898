"""Loads: the normal force on patches, links and the arm by integrating pressure, whatever presses.

::

    F = sum_j A_j p_j          over touched tactels and those within 35 mm of them

The areas A_j count gaps and seams as far as presses there are felt (``load_areas``). No contact is assumed: a
palm, an edge or ten fingers are integrated alike.

By how much such a sum is off, and how certain that is, depends on where a press is and how wide, which the
readings show in part: both are learned once from examples of tips, fingers, bars and palms (``load_errors``),
and the sum is corrected by it.

Standard deviation: noise and zeros of the tactels that are summed, what the zeros of a board have in common,
and that of the correction. A tactel that is missing counts as the mean of its neighbours, with that mean as
its standard deviation.

Failure modes: pressures below every threshold are no load; a tip in a gap that tactels barely feel reads like
a light touch beside it, and the deviation is as large as the load; what hangs over a rim is not on the skin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate.baseline import Baseline
from skinbus.estimate.contacts import Contacts, Quality
from skinbus.estimate.kernels import load_sums as k
from skinbus.estimate.kernels.array_table import array_table
from skinbus.estimate.kernels.layout import compile_layout, limit_of, step_of
from skinbus.estimate.kernels.load_sums import Sums, integrate
from skinbus.estimate.load_areas import Presses, learn_areas
from skinbus.estimate.load_errors import examples_of, learn_errors
from skinbus.estimate.validation import check_arm
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

DIFFERENT: Final = 2.25
"""Standard deviations of load and contacts beyond which their forces do not add up. Both contain what cannot
be seen of the same press: no finger of 300 and two thumbs are further off, one palm in five."""


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
    """Integrates the pressures of an arm; what it needs of geometry and laws is made once."""

    def __init__(self, arm: Arm) -> None:
        check_arm(arm)
        self.arm = arm
        self._noise = np.sqrt(arm.tactel_noise**2 + step_of(arm) ** 2 / 12.0)
        self._limit = np.asarray(limit_of(arm))
        self._all = np.ones(arm.n_tactels, np.bool_)
        self._no_zeros = np.zeros(arm.n_tactels)
        self._patches = np.arange(arm.n_patches)
        self._pressures = np.zeros(arm.n_tactels)
        self._touched = np.zeros(arm.n_tactels, np.int8)
        self._sums, presses = _make_sums(arm)
        self.areas = self._sums.area.copy()
        """(n_tactels,) m^2, by which a pressure is multiplied."""
        self._table = array_table(self._sums)
        self._nothing = _copy(self._sums)
        self._learn(presses)

    def _learn(self, presses: Presses) -> None:
        """Learn by how much sums are off under presses of all kinds on this arm."""
        w, threshold = self._sums, self.arm.tactel_threshold
        for kind in range(len(w.learned)):
            features, error = [], []
            for readings, force in examples_of(
                self.arm, presses, np.flatnonzero(w.kind == kind), self._noise
            ):
                for pressures, true in zip(readings, force, strict=True):
                    self._integrate(pressures, (pressures >= threshold).astype(np.int8), self._all)
                    (own,) = np.nonzero(w.error[:, 1])
                    if len(own) == 1 and w.total[k.FORCE] > 0.0 and w.kind[w.top[own[0]]] == kind:
                        features.append(w.features[own[0]].copy())
                        error.append(math.log(true / w.total[k.FORCE] * w.error[own[0], 0]))
            if len(error) > k.TERMS:  # of a board that feels no press nothing is known
                w.scale[kind], w.learned[kind] = learn_errors(np.array(features), np.array(error))

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
        """
        arm = self.arm
        if np.shape(pressures) != (arm.n_tactels,) or np.shape(touched) != (arm.n_tactels,):
            raise ValueError(f"pressures and touched must have shape ({arm.n_tactels},)")
        flags = self._all if valid is None else np.ascontiguousarray(valid, np.bool_)
        if flags.shape == (arm.n_patches,) != self._all.shape:
            flags = flags[arm.tactel_patch]
        if flags.shape != self._all.shape:
            raise ValueError(f"valid must have shape ({arm.n_patches},) or {self._all.shape}")
        self._touched[:], self._pressures[:] = touched, pressures
        if not self._touched.any() and flags.all() and math.isfinite(self._pressures.sum()):
            self._sums.root[:] = self._patches
            return self._nothing
        self._integrate(self._pressures, self._touched, flags, baseline)
        return _copy(self._sums)

    def _integrate(
        self, pressures: Floats, touched: npt.NDArray[np.int8], flags: Bools, baseline: Baseline | None = None
    ) -> None:
        if baseline is None:
            variance = doubt = zero = creep = self._no_zeros
            common = self._no_zeros[: self.arm.n_patches]
        else:
            _, zero, variance, doubt, common, _, creep = baseline.felt
        integrate(
            self._table,
            pressures,
            touched,
            flags,
            self._limit,
            self._noise,
            variance,
            doubt,
            zero,
            common,
            creep,
        )

    def flag_extended(self, contacts: Contacts, loads: Loads) -> None:
        """Set EXTENDED on contacts whose forces do not add up to the load, in place.

        ``loads`` are those measured last. Summed is over patches that one press may reach, where all contacts
        have a standard deviation: level ``kmeans`` has none.
        """
        if not len(contacts):
            return
        root = self._sums.root
        while not np.array_equal(root[root], root):
            root[:] = root[root]
        n = self.arm.n_patches
        press = root[contacts.patch]
        variance = contacts.covariance[:, 2, 2]
        unknown = np.bincount(press, variance <= 0.0, n) + np.bincount(root, loads.at_least, n)
        missing = np.bincount(root, loads.patches.force, n) - np.bincount(press, contacts.force, n)
        spread = np.bincount(root, loads.patches.force_sd, n) ** 2 + np.bincount(press, variance, n)
        extended = (unknown == 0.0) & (missing**2 > DIFFERENT**2 * spread)
        contacts.quality[extended[press]] |= Quality.EXTENDED


def _copy(sums: Sums) -> Loads:
    """Return copies of what a cycle has left."""
    total = sums.total
    return Loads(
        patches=_rows(sums.patches.copy()),
        links=_rows(sums.links.copy()),
        force=float(total[k.FORCE]),
        force_sd=math.sqrt(total[k.VARIANCE]),
        area=float(total[k.AREA]),
        area_sd=math.sqrt(total[k.AREA_VARIANCE]),
        at_least=sums.at_least.copy(),
    )


def _rows(table: Floats) -> LoadRows:
    """Return the columns of a table (n, 7), which becomes theirs."""
    squares = table[:, [k.VARIANCE, k.PLACE, k.AREA_VARIANCE]]
    force_sd, place_sd, area_sd = np.sqrt(squares).T
    return LoadRows(
        force=table[:, k.FORCE],
        force_sd=force_sd,
        s=table[:, k.S],
        a=table[:, k.A],
        place_sd=place_sd,
        area=table[:, k.AREA],
        area_sd=area_sd,
    )


def _make_sums(arm: Arm) -> tuple[Sums, Presses]:
    """Return the columns of an arm, and the presses that its errors are learned from."""
    n, p = arm.n_tactels, arm.n_patches
    lay = compile_layout(arm)
    areas = learn_areas(arm)
    period = arm.link_period[arm.tactel_link]
    away = arm.tactel_a - arm.patch_a[arm.tactel_patch]
    away = away - period * np.rint(away / np.where(period > 0.0, period, np.inf))
    spacing = np.sqrt(np.bincount(arm.tactel_patch, areas.cell) / np.diff(arm.patch_start))
    layouts = [(placed.patch.n_tactels, placed.patch.size) for placed in arm.patches]
    kinds = list(dict.fromkeys(layouts))
    sums = Sums(
        start=arm.patch_start.astype(np.int64),
        link=arm.patch_link.astype(np.int64),
        patch=arm.tactel_patch.astype(np.int64),
        period=np.array(arm.link_period[arm.patch_link]),
        centre_s=np.array(arm.patch_s),
        centre_a=np.array(arm.patch_a),
        away_s=arm.tactel_s - arm.patch_s[arm.tactel_patch],
        away_a=away,
        area=areas.area,
        cell=areas.cell,
        spacing=spacing,
        wide=np.log(areas.cell / spacing[arm.tactel_patch] ** 2),
        rim=areas.rim,
        kind=np.array([kinds.index(layout) for layout in layouts], np.int64),
        scale=np.ones((len(kinds), 4, k.FEATURES)),
        learned=np.zeros((len(kinds), 2, k.TERMS)),
        healthy=np.array(arm.tactel_healthy),
        near_start=areas.near.indptr.astype(np.int64),
        near=areas.near.indices.astype(np.int64),
        edge_start=np.array(lay.edge_start),
        edge=np.array(lay.edge_to),
        summed=np.zeros(n, np.bool_),
        variance=np.zeros(n),
        root=np.arange(p),
        top=np.arange(p),
        press=np.zeros((p, 10)),
        features=np.zeros((p, k.FEATURES)),
        error=np.zeros((p, 2)),
        noise=np.zeros(p),
        parts=np.zeros((p, 10)),
        at_least=np.zeros(p, np.bool_),
        patches=np.zeros((p, 7)),
        links=np.zeros((len(arm.links), 7)),
        total=np.zeros(7),
    )
    return sums, areas.presses
