"""Gathering on its own: whose readings of a cycle are believed."""

import numpy as np
import pytest

from skinbus.can.frame import FrameBatch
from skinbus.config.system import load_arm, ods_of
from skinbus.master.freshness import Freshness
from skinbus.master.gather import Gather
from skinbus.objects.readings import ReadingsPlan
from tests.packing import pack

MS = 1_000_000


@pytest.fixture
def gather():
    arm = load_arm("pad")
    plan = ReadingsPlan(arm, ods_of(arm))
    return Gather(plan, arm.n_tactels, Freshness(plan, 20 * MS))


def frames_of(gather, value):
    """The frames of all patches (the pad has one, which sends four) on which every tactel reads ``value``."""
    batch = FrameBatch(gather.plan.n_frames)
    pack(gather.plan, np.full(gather.plan.n_tactels, value, np.int32), batch, t_ns=0)
    return list(batch)


def take(gather, frames):
    """Hand the gather frames as one batch."""
    batch = FrameBatch(max(len(frames), 1))
    batch.extend(frames)
    gather.take(batch)


def cycle(gather, t_ms, frames):
    """One cycle in which these frames come; which patches are fresh."""
    gather.freshness.open(t_ms * MS, np.array([True]))
    gather.open(t_ms * MS, np.array([True]))
    take(gather, [frame._replace(t_ns=t_ms * MS) for frame in frames])
    gather.is_complete()
    return gather.close().tolist()


def test_frame_that_comes_a_cycle_late_never_makes_readings_of_two_cycles(gather):
    first, second = frames_of(gather, 1), frames_of(gather, 2)
    assert cycle(gather, 0, first[:3]) == [False]
    assert cycle(gather, 20, [first[3], *second[:3]]) == [False]  # all four TPDOs came, of two cycles
    assert gather.freshness.is_behind.tolist() == [True]
    assert cycle(gather, 40, frames_of(gather, 3)) == [False]  # its fourth TPDO may be a cycle behind
    assert (gather.counts == 3).all(), "known, should it come again, and not used"
    assert cycle(gather, 80, frames_of(gather, 4)) == [True]  # it is not: in a gap it sent nothing else


@pytest.mark.slow
def test_lost_frame_costs_its_cycle_and_the_next_which_is_a_gap(gather):
    readings = frames_of(gather, 1)
    times = [0, 20, 40, 60, 100, 120]
    fresh = [cycle(gather, t_ms, readings[:3] if t_ms == 40 else readings)[0] for t_ms in times]
    assert fresh == [True, True, False, False, True, True]
    assert gather.counters.lost == 1


def test_every_frame_is_accepted_or_lost_once(gather):
    """Late frames are not missing too; those that come a second time are lost as well."""
    readings, counters = frames_of(gather, 1), gather.counters
    cycle(gather, 0, readings[:1])
    take(gather, readings[1:3])
    assert (counters.accepted, counters.late, counters.lost) == (1, 2, 2)
    take(gather, readings[2:3])
    cycle(gather, 20, [])
    assert (counters.accepted, counters.late, counters.missing, counters.lost) == (1, 3, 1, 4)
