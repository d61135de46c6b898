"""Events as lines of a log: dated, equal ones of a moment in one line, and no more than can be read."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Final

from skinbus.can.event import Event
from skinbus.cli.formatting import counted, nodes
from skinbus.printable import printable

MOMENT_S: Final = 0.25
"""Equal events so close together are one line: a bus that fails takes all of its patches with it."""
BURST: Final = 6
WINDOW_S: Final = 10.0
"""So many lines of a kind and bus in such a time; the others are counted and reported at its end."""
MAX_WAITING: Final = 10_000
"""Events that wait to be shown; when a terminal is stopped for long, the oldest are lost."""


def wall_stamp(t: float) -> str:
    """Return a time of the monotonic clock as date and time of day, by the wall clock as it stands now."""
    t += time.time() - time.monotonic()
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(t)) + f".{int(10 * t) % 10}"


class _Stretch:
    """Events of a kind on a bus in a stretch of time: lines that wait, by detail, and the rest."""

    def __init__(self, since: float) -> None:
        self.since = since
        self.groups: dict[str, tuple[float, set[int]]] = {}
        self.n_lines = self.n_more = 0
        self.more: set[int] = set()


class EventLog:
    """``take`` is called by the thread that has the events and never waits; ``show`` by another."""

    def __init__(
        self,
        say: Callable[[str], Any],
        names: Sequence[str] = (),
        now: Callable[[], float] = time.monotonic,
        stamp: Callable[[float], str] = wall_stamp,
    ) -> None:
        """``names`` are those of the buses, said when there are several; ``stamp`` shows a time of ``now``.

        ``now`` never goes back: groups and rates are made by it.
        """
        self._say, self._now, self._stamp = say, now, stamp
        self._names = tuple(map(printable, names)) if len(names) > 1 else ()
        self._new: deque[tuple[float, Event]] = deque(maxlen=MAX_WAITING)
        self._stretches: dict[tuple[int, str], _Stretch] = {}

    def take(self, event: Event) -> None:
        """Take an event."""
        self._new.append((self._now(), event))

    def show(self, *, all_of_it: bool = False) -> None:
        """Say what is older than a moment, or everything at the end."""
        while self._new:
            t, event = self._new.popleft()
            stretch = self._stretches.setdefault((event.bus, str(event.kind)), _Stretch(t))
            if event.detail not in stretch.groups and stretch.n_lines < BURST:
                stretch.groups[event.detail] = t, set()
                stretch.n_lines += 1
            stretch.n_more += event.detail not in stretch.groups
            _, node_ids = stretch.groups.get(event.detail, (t, stretch.more))
            node_ids |= {event.node_id} - {0}
        now = self._now()
        for (bus, kind), stretch in list(self._stretches.items()):
            for detail, (since, node_ids) in list(stretch.groups.items()):
                if all_of_it or now - since >= MOMENT_S:
                    del stretch.groups[detail]
                    self._line(since, bus, kind, node_ids, detail)
            if all_of_it or (now - stretch.since >= WINDOW_S and not stretch.groups):
                del self._stretches[bus, kind]
                if stretch.n_more:
                    more = f"{counted(stretch.n_more, 'time')} more in {now - stretch.since:.0f} s"
                    self._line(now, bus, kind, stretch.more, more)

    def _line(self, t: float, bus: int, kind: str, node_ids: set[int], detail: str) -> None:
        where = [self._names[bus]] if self._names else []
        where += [nodes(node_ids)] if node_ids else []
        text = f"{self._stamp(t)} {kind}" + (f": {' '.join(where)}" if where else "")
        self._say(f"{text}, {printable(detail)}" if detail else text)
