"""Events as lines of a log: dated, equal ones of a moment in one line, and no more than can be read."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from skinbus.arrays import Bools
from skinbus.can.event import Event, EventKind
from skinbus.formatting import counted, nodes
from skinbus.model import Arm
from skinbus.printable import printable

NOT_FOR_PEOPLE = {EventKind.STOP, EventKind.DROPPED, EventKind.NMT_STATE, EventKind.PATCH_STARTED}
"""Kinds of events that are part of every day; the counters report dropped frames."""
MOMENT_S = 0.25
"""Equal events so close together are one line: a bus that fails takes all of its patches with it."""
BURST = 6
WINDOW_S = 10.0
"""So many lines of a kind and bus in such a time; the others are counted and reported at its end."""
LONGEST_S = 600.0
"""While they go on, what was said is counted over longer and longer times, up to this."""
MAX_WAITING = 10_000
"""Events that wait to be shown; when a terminal is stopped for long, the oldest are lost."""


def wall_stamp(t: float) -> str:
    """Return a time of the monotonic clock as date and time of day, by the wall clock as it stands now."""
    t += time.time() - time.monotonic()
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(t)) + f".{int(10 * t) % 10}"


def nodes_by_bus(arm: Arm, chosen: Bools) -> Iterator[str]:
    """Return for each bus the nodes of the patches that are chosen, with its name where there are several."""
    for bus, settings in enumerate(arm.buses):
        here = arm.patches_on(bus)
        if node_ids := arm.node_id[here][chosen[here]].tolist():
            yield (f"{settings.name} " if len(arm.buses) > 1 else "") + nodes(node_ids)


@dataclass(slots=True)
class _Stretch:
    """A stretch of time: lines of a kind of events on a bus, and those that are not shown; what was said."""

    since: float
    length: float = WINDOW_S
    said: set[tuple[str, int]] = field(default_factory=set)
    n: int = 0
    n_more: int = 0
    goes_on: bool = False
    more: set[int] = field(default_factory=set)


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
        self._groups: dict[tuple[int, str, str], tuple[float, list[int]]] = {}
        self._stretches: dict[tuple[int, str], _Stretch] = {}

    def take(self, event: Event) -> None:
        """Take an event; what is part of every day is passed over."""
        if event.kind not in NOT_FOR_PEOPLE:
            self._new.append((self._now(), event))

    def show(self, *, all_of_it: bool = False) -> None:
        """Say what is older than a moment, or everything at the end."""
        while self._new:
            t, event = self._new.popleft()
            group = self._groups.setdefault((event.bus, str(event.kind), event.detail), (t, []))
            group[1].append(event.node_id)
        now = self._now()
        for key, (since, senders) in list(self._groups.items()):
            if all_of_it or now - since >= MOMENT_S:
                del self._groups[key]
                (bus, kind, detail), node_ids = key, set(senders) - {0}
                stretch = self._stretches.setdefault((bus, kind), _Stretch(since))
                what = {(detail, node_id) for node_id in node_ids or {0}}
                is_known = what <= stretch.said
                if stretch.n < BURST and (stretch.length == WINDOW_S or not is_known):
                    stretch.n += 1
                    stretch.goes_on |= is_known
                    stretch.said |= what
                    self._line(since, bus, kind, node_ids, detail)
                else:
                    stretch.n_more += len(senders)
                    stretch.more |= node_ids
        for (bus, kind), stretch in list(self._stretches.items()):
            if all_of_it or now - stretch.since >= stretch.length:
                del self._stretches[bus, kind]
                if stretch.n_more or stretch.goes_on:
                    length = min(2 * stretch.length, LONGEST_S)
                    self._stretches[bus, kind] = _Stretch(now, length, stretch.said)
                if stretch.n_more:
                    more = f"{counted(stretch.n_more, 'time')} more in {now - stretch.since:.0f} s"
                    self._line(now, bus, kind, stretch.more, more)

    def _line(self, t: float, bus: int, kind: str, node_ids: set[int], detail: str) -> None:
        where = [self._names[bus]] if self._names else []
        where += [nodes(node_ids)] if node_ids else []
        text = f"{self._stamp(t)} {kind}" + (f": {' '.join(where)}" if where else "")
        self._say(f"{text}, {printable(detail)}" if detail else text)
