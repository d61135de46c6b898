"""Replay: a core that sends a recording at its own pace, and asks its host to end when it is over."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from skinbus.bus.core import NEVER, STOP, Event, Step
from skinbus.bus.frame import ERROR, Frame


class Replay:
    """Plays frames with the pauses they were recorded with, beginning at its first step.

    Error frames are left out: nobody can send them. One frame is read ahead, so any length will do.
    """

    cob_ids: frozenset[int] | None = frozenset()

    def __init__(self, frames: Iterable[Frame], *, speed: float = 1.0) -> None:
        """speed: 2.0 plays twice as fast as it was recorded."""
        if not speed > 0:
            raise ValueError(f"speed is {speed}; wanted above 0")
        self.n_played = 0
        self._frames = (frame for frame in frames if not frame.flags & ERROR)
        self._speed = speed
        self._next = next(self._frames, None)
        self._first_ns = self._next.t_ns if self._next else 0
        self._begin_ns: int | None = None
        self._ended = False

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Send what is due."""
        if self._begin_ns is None:
            self._begin_ns = now_ns
        due = []
        while self._next is not None and self._due_ns(self._next, self._begin_ns) <= now_ns:
            due.append(self._next)
            self._next = next(self._frames, None)
        self.n_played += len(due)
        if self._next is not None:
            return Step(due, (), self._due_ns(self._next, self._begin_ns))
        events = () if self._ended else (Event(t_ns=now_ns, kind=STOP, detail="end of recording"),)
        self._ended = True
        return Step(due, events, NEVER)

    def _due_ns(self, frame: Frame, begin_ns: int) -> int:
        return begin_ns + round((frame.t_ns - self._first_ns) / self._speed)
