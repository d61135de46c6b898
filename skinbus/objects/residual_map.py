"""A residual map as the bytes of its object: a header, then one signed byte for each point."""

from __future__ import annotations

import struct
from typing import Final

import numpy as np

from skinbus.model import ResidualMap

_HEADER: Final = struct.Struct("<BBHf")
"""Tactels, points along an axis, step in um, 1/m^2 of one count."""


def encode_map(found: ResidualMap | None) -> bytes:
    """Return the bytes of a map; none of no map.

    A byte resolves 1/127 of the largest value: of 3 % of a peak that is 0.02 %, a tenth of what a map leaves.
    """
    if found is None:
        return b""
    values = np.asarray(found.values, np.float64)
    largest = float(np.abs(values).max())
    scale = largest / 127.0 if largest > 0.0 else 1.0
    counts = np.rint(values / scale).astype(np.int8)
    header = _HEADER.pack(values.shape[0], values.shape[1], round(1e6 * found.step), scale)
    return header + counts.tobytes()


def decode_map(data: bytes, n_tactels: int) -> ResidualMap | None:
    """Return the map that bytes hold, None of none.

    Raises:
        ValueError: the bytes are no map of so many tactels.
    """
    if not data:
        return None
    if len(data) < _HEADER.size:
        raise ValueError(f"{len(data)} bytes are no residual map")
    n, points, step, scale = _HEADER.unpack_from(data)
    if n != n_tactels or len(data) != _HEADER.size + n * points * points:
        raise ValueError(f"{len(data)} bytes of {n} tactels are no residual map of {n_tactels}")
    counts = np.frombuffer(data, np.int8, offset=_HEADER.size).reshape(n, points, points)
    return ResidualMap(1e-6 * step, scale * counts.astype(np.float64))
