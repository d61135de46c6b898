"""stuck: readings freeze at what they were."""

import numpy as np

from skinbus.sim.effects.stuck import Stuck


def test_named_tactels_repeat_the_reading_of_their_time(apply, pad):
    counts = np.arange(6, dtype=np.int32)[:, None] * 100 + np.arange(16)
    effect = Stuck(tactels=((1, 4),), share=0.0, from_s=2.0)
    out = apply(effect, counts, np.arange(6.0), arm=pad, dtype=np.int32)
    np.testing.assert_array_equal(out[:, 3], [3, 103, 203, 203, 203, 203])
    others = np.delete(np.arange(16), 3)
    np.testing.assert_array_equal(out[:, others], counts[:, others])


def test_share_of_stuck_tactels_is_as_asked(apply, forearm):
    stuck = 0
    for seed in range(40):
        counts = np.zeros((2, forearm.n_tactels), np.int32)
        counts[1] = 7
        stuck += (apply(Stuck(share=0.1), counts, [0.0, 1.0], seed=seed, dtype=np.int32)[1] == 0).sum()
    n = 40 * forearm.n_tactels
    assert abs(stuck / n - 0.1) < 4 * np.sqrt(0.1 * 0.9 / n)


def test_tactel_that_the_arm_does_not_have_is_a_fault(pad):
    assert len(Stuck(tactels=((1, 17), (2, 1))).check(pad)) == 2
