"""A patch: one board of tactels under one compliance layer, as its EDS describes it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from skinbus.arrays import Bools, Floats
from skinbus.model.law import DEFAULT_LAW, Law
from skinbus.model.limits import ANY, LENGTH, MOST, MOST_LENGTH, SIZE, check_numbers
from skinbus.model.residual_map import ResidualMap
from skinbus.model.transducer import Transducer

MAX_TACTELS = 64
"""The width of the health mask."""


_LIMITS = {
    **dict.fromkeys(("threshold", "release", "noise", "zero_band", "zero_drift"), (0.0, MOST)),
    **dict.fromkeys(("gain", "offset", "bias"), ANY),
    "width": SIZE,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patch:
    """Everything a patch is in itself, wherever it is mounted; arrays are per tactel."""

    tactels_uv: Floats
    """(n_tactels, 2) m, from the patch centre; u to the right, v up."""
    diameter: float = 9.53e-3  # FlexiForce A201, the paper's section II
    """Active diameter of a tactel, m."""
    size: tuple[float, float] = (0.050, 0.050)
    """Extent along u and v, m."""
    transducer: Transducer = field(default_factory=lambda: Transducer(full_scale=250e3))
    law: Law = DEFAULT_LAW
    threshold: float = 1000.0  # five times the usual noise of 1 % of the peak of a 5 N contact (200 Pa)
    """Pressure at which a tactel counts as touched, Pa."""
    release: float = 700.0
    """Pressure below which a touched tactel counts as free again, Pa."""
    gain: float | Floats = 1.0
    """Factor from indicated to true pressure; one number, or (n_tactels,), as are those below."""
    offset: float | Floats = 0.0
    """Counts at no pressure."""
    width: float | Floats = 1.0
    """How much wider each tactel's response is than the law."""
    bias: float | Floats = 0.0
    """Pa, what a tactel reads too much under a press beside its zero."""
    residual_map: ResidualMap | None = None
    """What each tactel reads beside law, gain and width; None for nothing."""
    noise: float | Floats = 200.0
    """Standard deviation of a reading, Pa; one number, or (n_tactels,)."""
    zero_band: float | Floats | None = None
    """How far the zero of a tactel may lie from that of its calibration, Pa; one number, or (n_tactels,).

    None for 2.5 touch thresholds: 1 % of full scale of the usual board."""
    zero_drift: float | Floats | None = None
    """Standard deviation of the change of a zero in a minute, Pa; one number, or (n_tactels,).

    None for 0.3 touch thresholds, 0.12 % of full scale of the usual board: 0.3 % in 80 s is 2.3 of them."""
    healthy: bool | Bools = True
    """False for tactels known to be dead."""

    def __post_init__(self) -> None:
        uv = check_numbers("tactels_uv", self.tactels_uv, (-MOST_LENGTH, MOST_LENGTH))
        if uv.ndim != 2 or uv.shape[1] != 2 or not 1 <= len(uv) <= MAX_TACTELS:
            raise ValueError(
                f"tactels_uv must be of shape (n, 2) with n from 1 to {MAX_TACTELS}; got {uv.shape}"
            )
        check_numbers("size", self.size, LENGTH)
        check_numbers("diameter", self.diameter, LENGTH)
        for name, limits in _LIMITS.items():
            if (values := getattr(self, name)) is not None:
                np.broadcast_to(check_numbers(name, values, limits), len(uv))
        if self.residual_map is not None and len(self.residual_map.values) != len(uv):
            raise ValueError(f"residual_map must have a map for each of {len(uv)} tactels")
        np.broadcast_to(self.healthy, len(uv))

    @property
    def n_tactels(self) -> int:
        """Number of tactels."""
        return len(self.tactels_uv)

    @property
    def pitch(self) -> float:
        """Median distance of the tactels to their nearest neighbours, m; of a single one, its diameter."""
        uv = np.asarray(self.tactels_uv)
        if len(uv) < 2:
            return self.diameter
        d = np.hypot(*(uv[:, None] - uv).T)
        d[np.diag_indices_from(d)] = np.inf
        return float(np.median(d.min(axis=0)))

    def mirrored(self) -> Patch:
        """Return the board with v running the other way."""
        own = self.residual_map
        return replace(
            self,
            tactels_uv=np.asarray(self.tactels_uv) * (1.0, -1.0),
            residual_map=None if own is None else own.mirrored(),
        )

    @classmethod
    def default(cls) -> Self:
        """Return the paper's board: 4 x 4 tactels at 10 mm on a 50 mm square."""
        return cls(tactels_uv=grid(4, 4, 0.010))


def grid(columns: int, rows: int, pitch: float) -> Floats:
    """Return a centred grid of tactels, (columns * rows, 2) m, row by row from the lower left."""
    u = (np.arange(columns) - 0.5 * (columns - 1)) * pitch
    v = (np.arange(rows) - 0.5 * (rows - 1)) * pitch
    return np.stack([np.tile(u, rows), np.repeat(v, columns)], -1)
