"""Limits that a patch compares its readings with by itself, and what it says of them: the guard, as bytes.

The limits are one object, written whole, so that a patch never compares with half of them::

    n U8 | m U8 | sum limit I32 | by tactel: limit I16 | by tactel: weight U16 | by tactel: rest I16
    | CRC-16-CCITT of it all U16

little-endian, in counts as the readings are sent. A sample is beyond them when the reading of a tactel is
above its limit, or the sum of weight times (reading - rest) of the tactels above their rest is above the sum
limit: what reads less takes nothing from it. The guard trips when n of the last m samples are, the newest
among them. The CRC has the generator 0x1021 and begins with 0, as that of
0x13FF (EN 50325-5).
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from dataclasses import dataclass
from enum import IntFlag
from typing import Self

import numpy as np
from canopen.objectdictionary import ObjectDictionary

from skinbus.arrays import Ints
from skinbus.objects.pdo import PdoMap, tpdos
from skinbus.objects.profile import GUARD_STATE, has, index_of

GFC_ID = 0x001
"""Global fail-safe command (EN 50325-5): a frame without data that everybody who can stop obeys."""

NO_LIMIT = 0x7FFF
"""Of a tactel: no reading is above it."""

MAX_WEIGHT = 511
"""So large that the sum of 64 full readings above the lowest rest fits 32 bits."""

MAX_SAMPLES = 8
"""Largest m."""

_HEAD = struct.Struct("<BBi")


class GuardState(IntFlag):
    """Bits of "Guard/State"."""

    ARMED = 0x01
    """OPERATIONAL, limits are there, all guarded tactels are healthy, and the newest sample is not old."""
    TRIPPED = 0x02
    """A limit was exceeded; stays until it is acknowledged."""


@dataclass(frozen=True, slots=True)
class GuardLimits:
    """Limits of one patch."""

    n: int
    m: int
    sum_limit: int
    limits: Ints
    """(n_tactels,) counts."""
    weights: Ints
    """(n_tactels,) 0..MAX_WEIGHT; a tactel with weight 0 and NO_LIMIT is not guarded."""
    rest: Ints
    """(n_tactels,) counts at no pressure, rounded down."""

    @staticmethod
    def size(n_tactels: int) -> int:
        """Return the number of bytes of the object."""
        return _HEAD.size + 6 * n_tactels + 2

    def encode(self) -> bytes:
        """Return the bytes of the object."""
        body = _HEAD.pack(self.n, self.m, self.sum_limit)
        body += np.array([self.limits, self.weights, self.rest]).astype("<i2").tobytes()
        return body + crc_hqx(body, 0).to_bytes(2, "little")

    @classmethod
    def decode(cls, data: bytes, n_tactels: int) -> Self:
        """Return what the bytes of the object say.

        Raises:
            ValueError: wrong length, checksum, n, m or weight.
        """
        if len(data) != cls.size(n_tactels):
            raise ValueError(f"{len(data)} bytes; wanted {cls.size(n_tactels)}")
        if crc_hqx(data[:-2], 0) != int.from_bytes(data[-2:], "little"):
            raise ValueError("wrong checksum")
        n, m, sum_limit = _HEAD.unpack_from(data)
        columns = np.frombuffer(data, "<i2", 3 * n_tactels, _HEAD.size).reshape(3, -1).astype(np.int64)
        most = (columns[1] & 0xFFFF).max()
        if not 1 <= n <= m <= MAX_SAMPLES or most > MAX_WEIGHT:
            raise ValueError(f"{n} of {m} samples, weights up to {most}")
        return cls(n, m, sum_limit, *columns)


def liveness_pdo(od: ObjectDictionary) -> PdoMap | None:
    """Return the TPDO, valid or not, that carries "Guard/State"; None of a board that has none."""
    state = index_of(od, GUARD_STATE) if has(od, GUARD_STATE) else None
    return next((pdo for pdo in tpdos(od) if state in [(e.index, e.sub) for e in pdo.entries]), None)
