"""A bus and boards that come and go, a wall clock that steps: the log is short, every loss has its end."""

import pytest

from skinbus.can.event import EventKind
from skinbus.master.patches.table import PatchState
from tests.master.day import MAX_LOG, live

HOURS = 0.3
SEED = 20260104


@pytest.mark.slow
def test_a_third_of_an_hour_of_comings_and_goings(tmp_path):
    print(f"seed {SEED}")
    day, n_more_objects = live(HOURS, SEED, tmp_path)
    n = day.kinds
    assert n[EventKind.BUS_LOST] == n[EventKind.BUS_BACK] > 1
    lost = n[EventKind.READINGS_LOST] + n[EventKind.HEARTBEAT_LOST] + n[EventKind.PATCH_LOST]
    assert lost
    assert n[EventKind.PATCH_BACK]
    assert day.rig.master.table.state[0] == PatchState.OPERATIONAL
    ends = [line for line in day.lines if EventKind.PATCH_BACK in line or EventKind.READINGS_LOST in line]
    assert EventKind.PATCH_BACK in ends[-1]
    assert sum(len(line) + 1 for line in day.lines) < MAX_LOG * HOURS / 24.0
    assert n_more_objects < 500
