"""Frames that are held back until their time: what effects that make frames late share."""

from __future__ import annotations

from heapq import heappop, heappush

from skinbus.bus.core import NEVER
from skinbus.bus.frame import Frame


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

    def put(self, now_ns: int, frame: Frame, late_ns: int) -> None:
        """Hold a frame for a while; zero leaves with the next release."""
        due_ns = max(now_ns + late_ns, self._last_ns.get(frame.can_id, 0))
        self._last_ns[frame.can_id] = due_ns
        self._n += 1
        heappush(self._heap, (due_ns, self._n, frame))

    def release(self, now_ns: int, frames: list[Frame]) -> None:
        """Replace the contents of ``frames`` by what is due; its time is that of the release."""
        frames.clear()
        while self._heap and self._heap[0][0] <= now_ns:
            due_ns, _, frame = heappop(self._heap)
            frames.append(frame if due_ns == frame.t_ns else frame._replace(t_ns=now_ns))
