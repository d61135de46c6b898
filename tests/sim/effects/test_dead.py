"""dead: the right tactels, from the right time on."""

import numpy as np

from skinbus.sim.effects.dead import Dead


def test_named_tactels_read_nothing_from_their_time_on(apply, forearm):
    effect = Dead(tactels=((1, 1), (3, 16)), share=0.0, from_s=2.0)
    out = apply(effect, 1e4, [0.0, 1.99, 2.0, 5.0])
    assert (out[:2] == 1e4).all()
    for row in out[2:]:
        assert np.flatnonzero(row == 0.0).tolist() == [0, 2 * 16 + 15]


def test_share_of_dead_tactels_is_as_asked(apply, forearm):
    n = 40 * forearm.n_tactels
    dead = sum((apply(Dead(share=0.1), 1.0, [0.0], seed=s) == 0.0).sum() for s in range(40))
    assert abs(dead / n - 0.1) < 4 * np.sqrt(0.1 * 0.9 / n)


def test_tactels_that_the_arm_does_not_have_are_faults(forearm):
    faults = [str(f) for f in Dead(tactels=((99, 1), (1, 17), (1, 0), (1, 16))).check(forearm)]
    assert len(faults) == 3
    assert "node-IDs of arm forearm" in faults[0]
    assert "a tactel of 1 to 16" in faults[1]
