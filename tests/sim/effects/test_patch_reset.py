"""patch_reset: boards boot again, when told and at random."""

import numpy as np

from skinbus.sim.effect import stream
from skinbus.sim.effects.patch_reset import PatchReset


def test_named_board_boots_again_at_its_time(simulate, forearm):
    run = simulate([PatchReset(resets=((3, 0.2), (5, 0.3)), per_hour=0.0)], n_syncs=30, arm=forearm)
    boots = run.boots()
    assert [f.can_id - 0x700 for f in boots[24:]] == [3, 5]
    assert len(run.tpdos(3)) == 4 * 29, "the SYNC at which it resets is not answered"
    assert len(run.tpdos(4)) == 4 * 30


def test_board_that_nobody_starts_again_stays_quiet(simulate, forearm):
    run = simulate([PatchReset(resets=((3, 0.2),), per_hour=0.0)], n_syncs=30, arm=forearm, restart=False)
    assert len(run.tpdos(3)) == 4 * 10


def test_random_resets_come_at_their_rate(forearm):
    step = PatchReset(per_hour=60.0).bind(forearm, stream(7, "patch_reset"))
    frames = []
    for t_s in np.arange(0.0, 3600.0, 1.0):
        step.receive(0, float(t_s), frames)
    wanted = 60.0 * forearm.n_patches
    assert abs(len(frames) - wanted) < 4 * np.sqrt(wanted)
    nodes = np.array([f.data[1] for f in frames])
    assert set(nodes.tolist()) == set(forearm.node_id.tolist())


def test_node_that_the_arm_does_not_have_is_a_fault(pad):
    assert len(PatchReset(resets=((2, 1.0), (1, 1.0))).check(pad)) == 1
