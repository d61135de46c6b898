"""Frames of a skin that is not CANopen, put together to the readings of its patches; no clock, no I/O."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from skinbus.arrays import Floats
from skinbus.can.fd import CLASSIC_BYTES
from skinbus.can.frame import CobIds, Frame
from skinbus.gateway.frame_format import FrameFormat, Part
from skinbus.node.host import Sample

PATIENCE = 3
"""Periods after which a patch is silent, or can be told from two boards with one address."""

DOUBLED = 5
"""Times that one frame comes in so many periods if two boards send it; of one board it comes at most four."""

_NEVER_NS = -(2**62)


class Receiver:
    """The patches of a skin, by the frames that carry their readings.

    Args:
        found: what its frames look like.
        addresses: (n_patches,) of its patches.
    """

    def __init__(self, found: FrameFormat, addresses: Sequence[str]) -> None:
        self._format = found
        self.period_ns = round(1e6 * found.period_ms)
        self.n_foreign = 0
        """Frames that are of no patch: another identifier, other first bytes, too short, remote."""
        self._raw = np.zeros((len(addresses), found.n_tactels))
        self._patches = [
            _Patch(found, found.parts(address), raw)
            for address, raw in zip(addresses, self._raw, strict=True)
        ]
        self._at: dict[int, list[tuple[_Patch, int, Part]]] = {}
        for patch in self._patches:
            for k, part in enumerate(patch.parts):
                self._at.setdefault(part.can_id, []).append((patch, k, part))
        self._sample: Sample | None = None

    @property
    def can_ids(self) -> CobIds:
        """Identifiers that carry readings."""
        return frozenset(self._at)

    @property
    def faults(self) -> list[str]:
        """(n_patches,) why no reading of a patch is good; empty while its readings are."""
        return [patch.fault for patch in self._patches]

    def take(self, frame: Frame) -> None:
        """Take a frame; what is none of ours is counted."""
        can_id, data, t_ns, flags, _ = frame
        if not flags:
            for patch, k, part in self._at.get(can_id, ()):
                if data.startswith(part.data) and len(data) >= part.length:
                    if patch.take(k, data, t_ns, self.period_ns):
                        self._sample = None
                    return
        self.n_foreign += 1

    def newest(self, now_ns: int) -> Sample:
        """Return the newest complete readings; of boards that are silent or doubled nothing is healthy."""
        for patch in self._patches:
            if patch.is_judged_anew(now_ns, self.period_ns):
                self._sample = None
        if self._sample is None:
            healthy = np.concatenate([patch.healthy & (not patch.fault) for patch in self._patches])
            t_ns = np.array([patch.t_ns for patch in self._patches])
            self._sample = Sample(self._format.counts(self._raw.ravel()), t_ns, healthy)
        return self._sample


class _Patch:
    """What is received of one patch; its newest complete readings go to ``raw`` (n_tactels,)."""

    def __init__(self, found: FrameFormat, parts: Sequence[Part], raw: Floats) -> None:
        self.parts = parts
        self.t_ns = _NEVER_NS
        """When the first frame of that sample came, ns."""
        self.healthy = np.zeros(len(raw), np.bool_)
        self.fault = ""
        self._own_fault = ""
        """What the board says of itself."""
        self._raw, self._type = raw, np.dtype(found.type)
        size = self._type.itemsize
        self._bytes = np.zeros((len(raw), size), np.int64)
        """Where the readings are in the data of all parts, one after the other."""
        for k, part in enumerate(parts):
            begins = CLASSIC_BYTES * k + part.table.byte + size * np.arange(len(part.to))
            self._bytes[part.to[part.to >= 0]] = begins[part.to >= 0, None] + np.arange(size)
        self._data: dict[int, bytes] = {}
        """Parts of the next sample that have come."""
        self._first_ns = _NEVER_NS
        self._heard_ns = [deque([_NEVER_NS] * DOUBLED, DOUBLED) for _ in parts]

    def take(self, k: int, data: bytes, t_ns: int, period_ns: int) -> bool:
        """Take the data of part k; return whether there is a new sample."""
        self._heard_ns[k].append(t_ns)
        if k in self._data or t_ns - self._first_ns > period_ns // 2:  # what is there is of another sample
            self._data.clear()
        if not self._data:
            self._first_ns = t_ns
        self._data[k] = data
        if len(self._data) < len(self.parts):
            return False
        every = [self._data[k] for k in range(len(self.parts))]
        block = np.frombuffer(b"".join(data.ljust(CLASSIC_BYTES, b"\0") for data in every), np.uint8)
        self._raw[:] = block[self._bytes].view(self._type)[:, 0]
        pairs = list(zip(self.parts, every, strict=True))
        self.healthy[:] = True
        self.healthy[[tactel for part, data in pairs for tactel in part.unhealthy(data)]] = False
        self._own_fault = "; ".join(fault for part, data in pairs for fault in part.faults(data))
        self.t_ns = self._first_ns
        self._data.clear()
        return True

    def is_judged_anew(self, now_ns: int, period_ns: int) -> bool:
        """Find what is wrong with the patch; return whether that has changed."""
        before, self.fault = self.fault, self._own_fault
        since_ns = now_ns - PATIENCE * period_ns
        if self.t_ns < since_ns:
            self.fault = f"no complete readings for {PATIENCE} periods"
        elif any(heard_ns[0] > since_ns for heard_ns in self._heard_ns):
            self.fault = "two boards have this address, or it sends more often than the format says"
        return self.fault != before
