"""Where a skin feels what, for those who show it: the coverage of an arm on a coarse grid."""

from __future__ import annotations

from typing import Final

from skinbus.model import Arm
from skinbus.planning.coverage import Coverage as Coverage
from skinbus.planning.coverage import cover

STEP: Final = 0.004
"""Of the grid, m: fine against a tactel, and a whole arm takes a second or two."""


def coverage_of(arm: Arm) -> Coverage:
    """Return the coverage of an arm."""
    return cover(arm, step=STEP)
