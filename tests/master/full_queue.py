"""A send queue between a master and its bus that stops: it keeps what fits, and discards the rest."""

from skinbus.can.core import Core
from skinbus.can.event import Event, EventKind


class FullQueue(Core):
    """Takes the place of ``master.step``; nothing leaves it while ``is_stuck``; ``room`` frames fit in."""

    def __init__(self, master, room=0, *, reports=True):
        """With ``reports`` the interface says that the queue is full and that it is no longer."""
        self.room, self.reports = room, reports
        self.is_stuck = True
        self._kept = []
        self._is_full = False
        self._master, self._step = master, master.step
        master.step = self.step

    def step(self, now_ns, frames):
        step = self._step(now_ns, frames)
        if self.is_stuck:
            fits = max(self.room - len(self._kept), 0)
            self._kept += step.frames[:fits]
            if lost := list(step.frames[fits:]):
                if not self._is_full:
                    self._is_full = True
                    self._say(now_ns, EventKind.SEND_QUEUE_FULL)
                self._master.not_sent(now_ns, lost)
            return step._replace(frames=())
        kept, self._kept = self._kept, []
        if self._is_full:
            self._is_full = False
            self._say(now_ns, EventKind.SEND_QUEUE_FULL_END)
        return step._replace(frames=[*kept, *step.frames])

    def _say(self, now_ns, kind):
        if self.reports:
            self._master.bus_news(now_ns, Event(t_ns=now_ns, kind=kind))
