"""The truth of a simulation beside its contacts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """What a simulated finger really does in one cycle: the truth beside the contacts."""

    link: str
    s: float
    """Along the link, m."""
    a: float
    """Arc length around it, m."""
    point: Floats
    """(3,) m, in the frame of the link."""
    normal: Floats
    """(3,) outward unit normal, in the frame of the link."""
    force: float
    """Along the normal, N."""
