"""Events as lines of a log: dated, equal ones of a moment in one line, and no more than can be read."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

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
    tenths = f"{t % 1:.3f}"[1:3]
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(t)) + (tenths if t % 1 < 0.95 else ".9")


class Key(NamedTuple):
    """What equal events have in common."""

    bus: int
    kind: str
    detail: str


@dataclass(slots=True)
class Group:
    """Equal events of a moment."""

    since: float
    node_ids: set[int] = field(default_factory=set)


@dataclass(slots=True)
class Window:
    """Lines of a kind on a bus in a stretch of time."""

    since: float
    n_lines: int = 0
    n_more: int = 0
    node_ids: set[int] = field(default_factory=set)


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
        self._say = say
        self._names = tuple(map(printable, names)) if len(names) > 1 else ()
        self._now = now
        self._stamp = stamp
        self._new: deque[tuple[float, Event]] = deque(maxlen=MAX_WAITING)
        self._groups: dict[Key, Group] = {}
        self._windows: dict[tuple[int, str], Window] = {}

    def take(self, event: Event) -> None:
        """Take an event."""
        self._new.append((self._now(), event))

    def show(self, *, all_of_it: bool = False) -> None:
        """Say what is older than a moment, or everything at the end."""
        while self._new:
            t, event = self._new.popleft()
            group = self._groups.setdefault(Key(event.bus, str(event.kind), event.detail), Group(t))
            if event.node_id:
                group.node_ids.add(event.node_id)
        now = self._now()
        for key, group in list(self._groups.items()):
            if all_of_it or now - group.since >= MOMENT_S:
                del self._groups[key]
                self._line(key, group)
        for (bus, kind), window in list(self._windows.items()):
            if all_of_it or now - window.since >= WINDOW_S:
                del self._windows[bus, kind]
                self._tell_more(now, Key(bus, kind, ""), window)

    def _line(self, key: Key, group: Group) -> None:
        window = self._windows.setdefault((key.bus, key.kind), Window(group.since))
        if window.n_lines < BURST:
            window.n_lines += 1
            self._say(self._text(group.since, key, group.node_ids))
        else:
            window.n_more += 1
            window.node_ids |= group.node_ids

    def _tell_more(self, now: float, key: Key, window: Window) -> None:
        if window.n_more:
            more = key._replace(detail=f"{counted(window.n_more, 'time')} more in {now - window.since:.0f} s")
            self._say(self._text(now, more, window.node_ids))

    def _text(self, t: float, key: Key, node_ids: set[int]) -> str:
        bus = self._names[key.bus] if self._names else ""
        where = " ".join(word for word in (bus, nodes(node_ids) if node_ids else "") if word)
        return (
            f"{self._stamp(t)} {key.kind}"
            + (f": {where}" if where else "")
            + (f", {printable(key.detail)}" if key.detail else "")
        )
