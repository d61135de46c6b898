"""delay: constant and random lateness, in order."""

import numpy as np

from skinbus.sim.effects.delay import Delay

PERIOD_NS = 20_000_000


def test_lateness_has_its_constant_and_its_mean(simulate, forearm):
    run = simulate([Delay(constant_us=200.0, mean_us=100.0)], n_syncs=40, arm=forearm)
    late = np.array([f.t_ns % PERIOD_NS for f in run.tpdos()]) / 1e3
    n = len(late)
    assert n == 40 * 24 * 4
    assert late.min() >= 200.0
    assert abs(late.mean() - 300.0) < 4 * 100 / np.sqrt(n)
    assert abs(late.std() / 100.0 - 1.0) < 0.1


def test_frames_of_one_identifier_stay_in_order(simulate, pad):
    """With delays of many periods, the readings still come in the order in which they were taken."""
    plain = [f.data for f in simulate(n_syncs=60).frames if f.can_id == 0x181]
    late = [
        f.data
        for f in simulate([Delay(constant_us=0.0, mean_us=50_000.0)], n_syncs=60).frames
        if f.can_id == 0x181
    ]
    assert len(late) > 30
    assert late == plain[: len(late)]
