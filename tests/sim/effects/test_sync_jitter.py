"""sync_jitter: the instants of sampling scatter as they should."""

import numpy as np

from skinbus.sim.effect import stream
from skinbus.sim.effects.sync_jitter import SyncJitter


def test_sampling_instants_scatter_normally_about_the_right_ones(forearm):
    step = SyncJitter(sigma_us=100.0).bind(forearm, stream(7, "sync_jitter"))
    errors = np.array([step(0.02 * k) - 0.02 * k for k in range(4000)])
    assert abs(errors.mean()) < 4 * 100e-6 / np.sqrt(4000)
    assert abs(errors.std() / 100e-6 - 1.0) < 0.05


def test_all_patches_sample_at_the_same_wrong_instant(simulate):
    """While the force rises, jitter changes every loaded tactel by the same share."""
    right, wrong = simulate(n_syncs=4).counts, simulate([SyncJitter(sigma_us=3000.0)], n_syncs=4).counts
    loaded = right[3] > 300
    ratio = wrong[3][loaded] / right[3][loaded]
    assert abs(ratio[0] - 1.0) > 1e-3
    assert np.ptp(ratio) < 0.01
