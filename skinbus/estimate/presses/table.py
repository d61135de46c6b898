"""Presses as they were recorded, as columns, and where they are on their boards."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]
Bools = npt.NDArray[np.bool_]

WEAK = 0.3
"""Part of a strong press below which readings give no place: it was beside the board, or on its neighbour."""
BASE = 0.25
"""Part of the largest reading that is taken off before a centroid: under it is the foot of the law."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressTable:
    """One row is what one patch reads under one press.

    arm        the patches pressed, all of one kind
    patch      (n,) index of the patch that was read
    s, a       (n,) m, where the press is said to be, on the chart of its link
    force      (n,) N; None where it is not known, but the same in all
    pressures  (n, n_tactels) Pa, as the arm's gains give them; NaN for other patches and missing readings
    noise      (n, n_tactels) Pa, what single readings scattered by in a press; NaN where it is not known
    are_single whether the readings are single ones, not means over cycles
    """

    arm: Arm
    patch: Ints
    s: Floats
    a: Floats
    force: Floats | None
    pressures: Floats
    noise: Floats | None = None
    are_single: bool = True

    def __len__(self) -> int:
        return len(self.s)

    def only(self, rows: npt.NDArray[np.bool_] | Ints) -> PressTable:
        """Return some of the rows."""
        return replace(
            self,
            patch=self.patch[rows],
            s=self.s[rows],
            a=self.a[rows],
            force=None if self.force is None else self.force[rows],
            pressures=self.pressures[rows],
            noise=None if self.noise is None else self.noise[rows],
        )

    @property
    def link(self) -> Ints:
        """(n,) index of the link."""
        return np.asarray(self.arm.patch_link[self.patch], np.intp)

    def uv(self, s: Floats | None = None, a: Floats | None = None) -> Floats:
        """Return places on the chart in the frames of the boards, (n, 2) m; those of the table by default."""
        s, a = self.s if s is None else s, self.a if a is None else a
        out = np.zeros((len(self), 2))
        for p in np.unique(self.patch):
            rows = self.patch == p
            out[rows] = self.arm.on_board(int(p), s[rows], a[rows])
        return out

    def own(self, p: int) -> Floats:
        """Return what a patch reads in its rows, (n_rows, its tactels) Pa."""
        return np.asarray(self.pressures[self.patch == p][:, self.arm.tactels_of(p)])


def strength(table: PressTable) -> Floats:
    """Return the largest reading of each row per unit of force, (n,); 0 without a reading."""
    filled = np.where(np.isfinite(table.pressures), table.pressures, 0.0).max(axis=1)
    return np.asarray(filled if table.force is None else filled / table.force)


def read_uv(table: PressTable) -> Floats:
    """Return where the readings alone put the presses, (n, 2) m on their boards; NaN where they are weak.

    It is the centroid of what rises above a quarter of the largest reading: no law is needed for it. It errs
    by up to a quarter of the pitch, and stays within the tactels.
    """
    strong = strength(table)
    out = np.full((len(table), 2), np.nan)
    for p in np.unique(table.patch):
        rows = np.flatnonzero(table.patch == p)
        own = np.nan_to_num(table.own(int(p)), nan=0.0)
        weight = np.maximum(own - BASE * own.max(axis=1, keepdims=True), 0.0)
        total = weight.sum(axis=1)
        enough = (strong[rows] > WEAK * np.quantile(strong[rows], 0.75)) & (total > 0.0)
        uv = np.asarray(table.arm.patches[p].patch.tactels_uv)
        out[rows[enough]] = (weight @ uv)[enough] / total[enough, None]
    return out
