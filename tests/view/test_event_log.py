"""The log of events: dated, grouped, and no more than people can read."""

import re

import pytest

from skinbus.can.event import Event
from skinbus.view.event_log import BURST, MOMENT_S, EventLog


class Log:
    """An event log on a clock of its own."""

    def __init__(self, names=()):
        self.t = 1_000_000.0
        self.lines = []
        self.log = EventLog(self.lines.append, names, lambda: self.t)

    def take(self, kind, node_id=0, detail="", bus=0):
        self.log.take(Event(t_ns=0, kind=kind, node_id=node_id, detail=detail, bus=bus))

    def said(self, after=MOMENT_S, **end):
        self.t += after
        self.log.show(**end)
        lines, self.lines[:] = list(self.lines), []
        assert all(re.match(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d ", line) for line in lines)
        return [line[22:] for line in lines]


def test_equal_events_of_a_moment_are_one_line():
    log = Log(["upper", "lower"])
    for node_id in range(1, 28):
        log.take("readings-lost", node_id)
    log.take("bus-lost", bus=1)
    log.take("patch-emcy", 3, "0x8120")
    assert log.said(after=0.0) == []  # others may still come
    assert log.said() == [
        "readings-lost: upper nodes 1-27",
        "bus-lost: lower",
        "patch-emcy: upper node 3, 0x8120",
    ]
    assert log.said() == []


@pytest.mark.parametrize(
    ("every_s", "n_shown", "more"), [(MOMENT_S, BURST, "34 times"), (2.0, 5, "10 times")]
)
def test_of_an_hour_of_the_same_some_lines_are_shown_and_the_rest_is_counted(every_s, n_shown, more):
    log = Log()
    n, lines = round(3600 / every_s), []
    for k in range(n):
        log.take("readings-lost", 1 + k % 3)
        lines += log.said(after=every_s)
    assert lines[n_shown].startswith(f"readings-lost: nodes 1-3, {more} more in ")
    assert len(lines) < 20
    log.take("readings-lost", 4)
    assert log.said() == ["readings-lost: node 4"]  # of another it is news
    lines += log.said(all_of_it=True)
    shown = [line for line in lines if "more" not in line]
    counts = [int(re.search(r"(\d+) times? more", line)[1]) for line in lines if "more" in line]
    assert len(shown) + sum(counts) == n


def test_what_has_ceased_for_long_is_news_again():
    log = Log()
    for _ in range(100):
        log.take("readings-lost", 1)
        log.said()
    log.said(after=1000.0)
    log.said(after=1000.0)
    log.take("readings-lost", 1)
    assert log.said() == ["readings-lost: node 1"]
