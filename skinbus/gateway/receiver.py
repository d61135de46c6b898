"""Frames of a skin that is not CANopen, put together to the readings of its patches; no clock, no I/O."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from skinbus.can.frame import Frame
from skinbus.gateway.frame_format import FrameFormat, Part
from skinbus.node.host import Sample

PATIENCE: Final = 3
"""Periods after which a patch is silent, or can be told from two boards with one address."""

DOUBLED: Final = 5
"""Times that one frame comes in so many periods if two boards send it; of one board it comes at most four."""

_NEVER_NS: Final = -(2**62)


class Receiver:
    """The patches of a skin, by the frames that carry their readings.

    Args:
        found: what its frames look like.
        addresses: (n_patches,) of its patches.
    """

    def __init__(self, found: FrameFormat, addresses: Sequence[str]) -> None:
        self.period_ns = round(1e6 * found.period_ms)
        self.n_foreign = 0
        """Frames that are of no patch: another identifier, other first bytes, too short, remote."""
        self._patches = [_Patch(found, found.parts(address)) for address in addresses]
        self._at: dict[int, list[tuple[_Patch, int, Part]]] = {}
        for patch in self._patches:
            for k, part in enumerate(patch.parts):
                self._at.setdefault(part.can_id, []).append((patch, k, part))
        self._sample: Sample | None = None
        self._healthy = np.zeros(found.n_tactels * len(addresses), np.bool_)

    @property
    def can_ids(self) -> frozenset[int]:
        """Identifiers that carry readings."""
        return frozenset(self._at)

    @property
    def faults(self) -> list[str]:
        """(n_patches,) why no reading of a patch is good; empty while its readings are."""
        return [patch.fault for patch in self._patches]

    def take(self, frame: Frame) -> None:
        """Take a frame; what is none of ours is counted."""
        if not frame.flags:
            for patch, k, part in self._at.get(frame.can_id, ()):
                if frame.data.startswith(part.data) and len(frame.data) >= part.table.length:
                    if patch.take(k, frame.data, frame.t_ns, self.period_ns):
                        self._sample = None
                    return
        self.n_foreign += 1

    def newest(self, now_ns: int) -> Sample:
        """Return the newest complete readings; of boards that are silent or doubled nothing is healthy."""
        for patch in self._patches:
            if patch.is_judged_anew(now_ns, self.period_ns):
                self._sample = None
        if self._sample is None:
            patches = self._patches
            healthy = np.concatenate([patch.healthy & (not patch.fault) for patch in patches])
            if not np.array_equal(healthy, self._healthy):
                self._healthy = healthy
            counts = np.concatenate([patch.counts for patch in patches])
            self._sample = Sample(counts, np.array([patch.t_ns for patch in patches]), self._healthy)
        return self._sample


class _Patch:
    """What is received of one patch."""

    def __init__(self, found: FrameFormat, parts: Sequence[Part]) -> None:
        self.parts = parts
        self.counts = np.zeros(found.n_tactels, np.int32)
        """(n_tactels,) of the newest complete sample."""
        self.t_ns = _NEVER_NS
        """When the first frame of that sample came, ns."""
        self.healthy = np.zeros(found.n_tactels, np.bool_)
        self.fault = ""
        self._own_fault = ""
        """What the board says of itself."""
        self._format = found
        self._data: dict[int, bytes] = {}
        """Parts of the next sample that have come."""
        self._first_ns = _NEVER_NS
        self._heard_ns = np.full((len(parts), DOUBLED), _NEVER_NS)

    def take(self, k: int, data: bytes, t_ns: int, period_ns: int) -> bool:
        """Take the data of part k; return whether there is a new sample."""
        heard_ns = self._heard_ns[k]
        heard_ns[:-1] = heard_ns[1:]
        heard_ns[-1] = t_ns
        if k in self._data or t_ns - self._first_ns > period_ns // 2:  # what is there is of another sample
            self._data.clear()
        if not self._data:
            self._first_ns = t_ns
        self._data[k] = data
        if len(self._data) < len(self.parts):
            return False
        raw = np.zeros(len(self.counts))
        self.healthy[:] = True
        faults = []
        for part, data in ((part, self._data[k]) for k, part in enumerate(self.parts)):
            used = part.to >= 0
            raw[part.to[used]] = part.readings(data)[used]
            self.healthy[part.unhealthy(data)] = False
            faults.append(part.fault(data))
        self._own_fault = "; ".join(filter(None, faults))
        self.counts, self.t_ns = self._format.counts(raw), self._first_ns
        self._data.clear()
        return True

    def is_judged_anew(self, now_ns: int, period_ns: int) -> bool:
        """Find what is wrong with the patch; return whether that has changed."""
        before, self.fault = self.fault, self._own_fault
        if now_ns - self.t_ns > PATIENCE * period_ns:
            self.fault = f"no complete readings for {PATIENCE} periods"
        elif (self._heard_ns[:, 0] > now_ns - PATIENCE * period_ns).any():
            self.fault = "two boards have this address, or it sends more often than the format says"
        return self.fault != before
