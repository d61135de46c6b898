"""loss: the right share, frame by frame, independent of other traffic."""

import numpy as np

from skinbus.sim.effects.babbling_node import BabblingNode
from skinbus.sim.effects.loss import Loss


def test_share_of_lost_frames_is_the_probability(simulate, forearm):
    run = simulate([Loss(probability=0.1)], n_syncs=50, arm=forearm)
    n = 50 * 24 * 4
    assert abs(len(run.tpdos()) / n - 0.9) < 4 * np.sqrt(0.1 * 0.9 / n)


def test_other_traffic_does_not_change_which_readings_are_lost(simulate, pad):
    alone = simulate([Loss(probability=0.3)], n_syncs=50)
    crowded = simulate([Loss(probability=0.3), BabblingNode()], n_syncs=50)
    assert [f[:2] for f in alone.tpdos()] == [f[:2] for f in crowded.tpdos()]


def test_all_or_none(simulate, pad):
    assert not simulate([Loss(probability=1.0)], n_syncs=5, restart=False).frames
