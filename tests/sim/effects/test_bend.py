"""bend: preload where a flat board stands off a curved link."""

import numpy as np

from skinbus.sim.effects.bend import Bend


def test_preload_is_stiffness_times_stand_off(apply, forearm):
    out = apply(Bend(kpa_per_mm=0.5), 0.0, [0.0])[0]
    surface = forearm.links[0].surface
    radius = float(forearm.link_radius[0])
    w = np.array([-15, -5, 5, 15]) * 1e-3
    wanted = 0.5e6 * w**2 / (2 * radius)
    for p in range(forearm.n_patches):
        around = surface.wrap(forearm.tactel_a[forearm.tactels_of(p)] - forearm.patch_a[p])
        np.testing.assert_allclose(out[forearm.tactels_of(p)], 0.5e6 * around**2 / (2 * radius), atol=1e-6)
    np.testing.assert_allclose(np.unique(np.round(out, 3)), np.unique(np.round(wanted, 3)))


def test_preload_is_constant_and_adds_to_any_pressure(apply):
    out = apply(Bend(), 1000.0, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(out[0], out[2])
    np.testing.assert_allclose(out[0] - 1000.0, apply(Bend(), 0.0, [0.0])[0], atol=1e-9)


def test_board_on_a_plane_is_not_bent(apply, pad):
    assert not apply(Bend(kpa_per_mm=50.0), 0.0, [0.0], arm=pad).any()
