"""What is used as fresh was sampled for this SYNC, however patches are late, torn, mute or doubled."""

import numpy as np
import pytest

from skinbus.can.event import EventKind
from tests.bus.cores import Repeater
from tests.master.misbehaving_rig import OTHER_SYNC, MisbehavingRig, booted
from tests.master.rig import MS

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("from_the_start", "periods", "first_late"),  # all its TPDOs, or the last one: readings of two cycles
    [
        *((True, n, 1) for n in (1.05, 1.3, 2.3, 6.5)),
        *((False, n, 1) for n in (1.3, 1.99, 3.2, 10.5)),
        (True, 1.3, 4),
        (False, 1.3, 4),
    ],
)
def test_patch_that_is_always_late_by_more_than_a_period_is_never_fresh_and_named(
    periods, from_the_start, first_late
):
    rig = MisbehavingRig("pad") if from_the_start else booted("pad")
    rig.patches.delay = lambda node_id, tpdo: periods * rig.period_ns * (tpdo >= first_late)
    rig.run(300)  # while it begins, it owes answers that never were late
    if not from_the_start:
        assert EventKind.READINGS_LOST in rig.kinds()
    assert rig.fresh(4000) == 0.0
    assert EventKind.READINGS_LOST in rig.kinds()
    assert not rig.violations


def test_patch_that_never_answers_in_full_costs_the_others_no_latency():
    rig = booted("forearm")
    node_id = int(rig.scene.arm.node_id[3])

    def p50_ms():
        cycles, _, _ = rig.run(2000)
        share = np.mean([cycle.fresh for cycle in cycles], axis=0)
        return np.median([cycle.latency_ns for cycle in cycles]) / MS, share

    before, _ = p50_ms()
    rig.patches.delay = lambda node, tpdo: None if (node, tpdo) == (node_id, 2) else 0
    after, share = p50_ms()
    assert after < 1.1 * before
    assert share[3] == 0.0
    others = np.delete(share, 3)
    assert (others >= 0.999).all()
    assert not rig.violations


def test_nothing_is_fresh_while_another_master_sends_sync():
    rig = booted("pad")
    now_ns = rig.wire.clock.now_ns()
    rig.wire.attach(Repeater(OTHER_SYNC, round(1e9 / 70), now_ns + 7 * MS, now_ns + 3000 * MS))
    rig.run(30)
    assert rig.fresh(2900) == 0.0
    assert EventKind.OTHER_MASTER in rig.kinds()
    rig.run(12_000)
    assert (rig.fresh(400) == 1.0).all()
    assert not rig.violations
