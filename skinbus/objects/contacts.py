"""Contacts in TPDOs: columns in SI units to payloads of 8 bytes; what does not fit saturates.

::

    byte  0   id                      U8
          1   link (low nibble), state (high nibble)
          2   s       I16, 0.1 mm
          4   a       I16, 0.1 mm
          6   force   U16, 0.01 N

Standard deviations in one byte are rounded up: 255 is "that or more", or not known.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Bytes, Floats

PAYLOAD = np.dtype([("id", "u1"), ("link_state", "u1"), ("s", "<i2"), ("a", "<i2"), ("force", "<u2")])
"""Layout of the 8 bytes."""

LENGTH_STEP = 1e-4
"""Metres per count of s and a."""
FORCE_STEP = 1e-2
"""Newtons per count of force."""
FORCE_SD_STEP = 5e-2
"""Newtons per count of the standard deviation of a force; that of a place is in ``LENGTH_STEP``."""
MAX_LINKS = 16
"""Links that the low nibble can distinguish."""


class ContactState(IntEnum):
    """What a contact does, in the high nibble."""

    NONE = 0
    TOUCH = 1
    HELD = 2
    LIFT = 3
    COAST = 4
    """Not seen in this cycle: place and force are those of when it was last seen."""


def pack_contacts(
    *,
    id: npt.ArrayLike,
    link: npt.ArrayLike,
    state: npt.ArrayLike,
    s: npt.ArrayLike,
    a: npt.ArrayLike,
    force: npt.ArrayLike,
) -> npt.NDArray[np.void]:
    """Return the payloads of contacts, (n,) of ``PAYLOAD``.

    Args:
        id:    (n,) 0..255
        link:  (n,) 0..15
        state: (n,) of :class:`ContactState`
        s, a:  (n,) m, saturating at 3.2767 m
        force: (n,) N, saturating at 0 and 655.35 N; NaN reads as 0
    """
    ids = np.atleast_1d(np.asarray(id))
    records = np.zeros(len(ids), PAYLOAD)
    records["id"] = ids
    records["link_state"] = (np.asarray(link, int) & 0xF) | (np.asarray(state, int) & 0xF) << 4
    records["s"] = _saturate(s, LENGTH_STEP, -0x8000, 0x7FFF)
    records["a"] = _saturate(a, LENGTH_STEP, -0x8000, 0x7FFF)
    records["force"] = _saturate(force, FORCE_STEP, 0, 0xFFFF)
    return records


def pack_deviations(covariance: npt.ArrayLike) -> tuple[Bytes, Bytes]:
    """Return the standard deviations of place (its longer axis, 0.1 mm) and force (0.05 N), (n,) each.

    Args:
        covariance: (n, 3, 3) of s, a (m) and force (N); 0 where nothing is known
    """
    c = np.nan_to_num(np.asarray(covariance, np.float64), nan=0.0, posinf=1e30, neginf=0.0)
    half, diff = (c[:, 0, 0] + c[:, 1, 1]) / 2.0, (c[:, 0, 0] - c[:, 1, 1]) / 2.0
    variances = np.stack([half + np.hypot(diff, c[:, 0, 1]), c[:, 2, 2]])
    variances[~(variances > 0.0)] = np.inf
    counts = np.ceil(np.sqrt(variances) / [[LENGTH_STEP], [FORCE_SD_STEP]])
    place, force = np.minimum(counts, 0xFF).astype(np.uint8)
    return place, force


def _saturate(values: npt.ArrayLike, step: float, low: int, high: int) -> Floats:
    counts = np.nan_to_num(np.asarray(values, np.float64) / step, nan=0.0, posinf=high, neginf=low)
    return np.clip(np.rint(counts), low, high)
