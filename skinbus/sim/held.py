"""Frames that are late: held back until their time."""

from __future__ import annotations

from heapq import heappop, heappush

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame


class Held:
    """A heap of late frames; frames of one identifier leave in the order in which they came."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, Frame]] = []
        self._last_ns: dict[int, int] = {}
        self._n = 0

    @property
    def wake_ns(self) -> int:
        """When the next frame is due, ns."""
        return self._heap[0][0] if self._heap else NEVER

    def release(self, now_ns: int) -> list[Frame]:
        """Return what is due of what is held."""
        due = []
        while self._heap and self._heap[0][0] <= now_ns:
            due.append(heappop(self._heap)[2])
        return due

    def sort_out(self, now_ns: int, frames: list[Frame]) -> list[Frame]:
        """Return what of ``frames`` leaves now, by the time of each, and hold the rest."""
        due = []
        last_ns = self._last_ns
        for frame in frames:
            can_id, _, t_ns, _, _ = frame
            if t_ns <= now_ns and last_ns.get(can_id, 0) <= now_ns:
                due.append(frame)
                continue
            last_ns[can_id] = due_ns = max(t_ns, last_ns.get(can_id, 0))
            self._n += 1
            heappush(self._heap, (due_ns, self._n, frame))
        return due
