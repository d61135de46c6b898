"""What cycles begin with in a recording, and how often."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from skinbus.can.frame import EXTENDED, NO_DATA, Frame
from skinbus.objects import cia

LEAST_PAUSES: Final = 3
"""Between cycles, from which their rate is found."""

LOWEST_HZ: Final = 1.0
HIGHEST_HZ: Final = 10_000.0
"""Of an arm file, and of a bus."""


class Sync(NamedTuple):
    """What cycles begin with in a recording."""

    bus: int | None
    """Whose SYNCs, those of the first bus that has some; None: there are none."""
    rate_hz: float | None
    """How often; None when that cannot be determined."""


def find_sync(frames: Iterable[Frame], data_ids: Sequence[frozenset[int]]) -> Sync:
    """Look for it in the frames with which a recording begins; ``data_ids`` by bus are those of readings."""
    syncs: dict[int, list[int]] = {}
    readings: dict[tuple[int, int], list[int]] = {}
    for can_id, _, t_ns, flags, bus in frames:
        if can_id == cia.SYNC_ID and not flags:
            syncs.setdefault(bus, []).append(t_ns)
        elif can_id in data_ids[bus] and not flags & (NO_DATA | EXTENDED):
            readings.setdefault((bus, can_id), []).append(t_ns)
    if syncs:
        return Sync(min(syncs), _rate_of(syncs[min(syncs)]))
    return Sync(None, _rate_of(max(readings.values(), key=len, default=[])))


def _rate_of(times_ns: Sequence[int]) -> float | None:
    """Return the usual rate of what came at these times, within what a SYNC can have, Hz."""
    pauses = np.diff(np.array(times_ns, object)).astype(np.float64)
    if len(pauses) < LEAST_PAUSES or not (middle := float(np.median(pauses))) > 0.0:
        return None
    return min(max(1e9 / middle, LOWEST_HZ), HIGHEST_HZ)
