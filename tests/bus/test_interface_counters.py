"""Losses that no socket reports: the counter of the interface is read."""

import pytest

from skinbus.bus.socketcan_babble import BacklogDrops
from skinbus.can.error_frames import FaultWatch
from skinbus.can.event import EventKind
from tests.files import put


@pytest.fixture
def statistic(tmp_path):
    return put(tmp_path, "rx_dropped", "4711\n")


def test_a_counter_that_begins_anew_or_cannot_be_read_takes_nothing_back(statistic, tmp_path):
    drops = BacklogDrops(statistic)
    statistic.write_text("4800\n")
    drops.look()
    for broken in ("0\n", ""):
        statistic.write_text(broken)
        drops.look()
        assert drops.n == 4800 - 4711
    nowhere = BacklogDrops(tmp_path / "nowhere")
    nowhere.look()
    assert nowhere.n == 0


def test_each_loss_is_reported_once_with_its_count():
    watch = FaultWatch()
    (event,) = watch.news(0, 7)
    assert (event.kind, event.count) == (EventKind.FRAMES_DROPPED, 7)
    assert watch.news(0, 7) == []
    (event,) = watch.news(0, 9)
    assert event.count == 2
