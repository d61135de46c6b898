"""Gathering on its own: each frame has one fate."""

import numpy as np

from skinbus.can.frame import Frame, FrameBatch
from skinbus.config.system import load_arm, ods_of
from skinbus.master.freshness import Freshness
from skinbus.master.gather import Gather
from skinbus.objects.readings import ReadingsPlan

MS = 1_000_000


def test_every_frame_is_accepted_or_lost_once():
    """Late frames are not missing too; those that come a second time are lost as well."""
    arm = load_arm("pad")
    plan = ReadingsPlan(arm, ods_of(arm))
    gather = Gather(plan, arm.n_tactels, Freshness(plan, 20 * MS), 100 * MS)
    counters, four = gather.counters, [Frame(cob_id, bytes(8)) for cob_id in plan.cob_ids_on[0]]

    def take(first, last):
        batch = FrameBatch(4)
        batch.extend(four[first:last])
        gather.take(batch)

    gather.open(0, np.array([True]))
    take(0, 1)
    gather.close()
    take(1, 3)
    assert (counters.accepted, counters.late, counters.lost) == (1, 2, 2)
    take(2, 3)
    gather.open(20 * MS, np.array([True]))
    assert (counters.accepted, counters.late, counters.missing, counters.lost) == (1, 3, 1, 4)
