"""The log of events: dated, grouped, and no more than people can read."""

import re

from skinbus.can.event import Event
from skinbus.cli.event_log import BURST, MOMENT_S, WINDOW_S, EventLog


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


def test_of_a_storm_some_lines_are_shown_and_the_rest_is_counted():
    log = Log()
    lines = []
    for k in range(100):
        log.take("readings-lost", 1 + k % 3)
        lines += log.said(after=MOMENT_S)
    seconds = 100 * MOMENT_S
    assert BURST < len(lines) <= (BURST + 1) * (1 + seconds / WINDOW_S)
    assert "readings-lost: nodes 1-3, 34 times more in 10 s" in lines
    lines += log.said(all_of_it=True)
    shown = [line for line in lines if "more" not in line]
    counts = [int(re.search(r"(\d+) times? more", line)[1]) for line in lines if "more" in line]
    assert len(shown) + sum(counts) == 100


def test_at_the_end_everything_is_said():
    log = Log()
    log.take("patch-lost", 7)
    assert log.said(after=0.0, all_of_it=True) == ["patch-lost: node 7"]
