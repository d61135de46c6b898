"""Whether what tactels read of no touch was taken off: it shows where no press is near."""

from __future__ import annotations

import numpy as np

from skinbus.estimate.presses.table import Floats, PressTable

SILENT = 0.01
"""Part of the peak, by the law that a board has, below which a press counts as not near a tactel."""
FEWEST = 3
"""Presses that are not near a tactel from which the median of what it reads is known."""
MOST = 0.02
"""Of a strong press that tactels may read then: rubber leaves less than 1 %; 3 to 5 % move places by a
millimetre."""


def zero_faults(table: PressTable) -> list[str]:
    """Return the boards whose tactels read something of presses that are elsewhere, as sentences."""
    faults = []
    force = 1.0 if table.force is None else float(np.median(table.force))
    for p in np.unique(table.patch).tolist():
        rows, here = table.patch == p, table.arm.tactels_of(p)
        own = table.own(p)
        law = table.arm.patches[p].patch.law
        d = table.arm.distance(here, table.s[rows], table.a[rows])
        share = np.abs(law.pressure(d, force)) / law.pressure(np.zeros(1), force)
        zero = _medians(np.where(share < SILENT, own, np.nan))
        strong = float(np.nanquantile(np.nanmax(own, axis=1, initial=0.0), 0.75))
        off = float(np.sqrt(np.mean(zero**2))) if len(zero) else 0.0
        if off > MOST * strong > 0.0:
            node, percent = table.arm.node_label(p), 100 * off / strong
            faults.append(
                f"tactels of node {node} read {1e-3 * off:.2g} kPa where no press is near, {percent:.0f} % "
                "of a strong press: their zeros are not taken off; add lines with force_n 0, of readings "
                "while nothing touches"
            )
    return faults


def _medians(readings: Floats) -> Floats:
    """Return the medians of the columns that have readings enough."""
    known = np.isfinite(readings).sum(axis=0) >= FEWEST
    return np.asarray(np.nanmedian(readings[:, known], axis=0))
