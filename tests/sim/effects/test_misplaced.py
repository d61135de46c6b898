"""misplaced: boards move as rigid bodies on the surface, by as much as they should."""

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.sim.effects.misplaced import Misplaced
from skinbus.sim.layer import Geometry


def displacements(geometry, arm):
    """Return (ds, da, turn) of each patch, from its tactels on the development about its centre."""
    out = []
    for p, placed in enumerate(arm.patches):
        at, surface = arm.tactels_of(p), arm.links[placed.link].surface
        before = np.stack(surface.develop(arm.tactel_s[at], arm.tactel_a[at], placed.a), -1) - [placed.s, 0.0]
        after = np.stack(surface.develop(geometry.s[at], geometry.a[at], placed.a), -1) - [placed.s, 0.0]
        shift = after.mean(axis=0) - before.mean(axis=0)
        x, y = (before - before.mean(axis=0)).T, (after - after.mean(axis=0)).T
        turn = np.arctan2((x[0] * y[1] - x[1] * y[0]).sum(), (x[0] * y[0] + x[1] * y[1]).sum())
        np.testing.assert_allclose(np.hypot(*x), np.hypot(*y), atol=1e-9)
        out.append((*shift, turn))
    return np.array(out)


@pytest.mark.parametrize("name", ["pad", "forearm", "arm"])
def test_boards_stay_rigid_on_every_surface(mount, name):
    arm = load_arm(name)
    displacements(mount(Misplaced(sigma_mm=2.0, sigma_deg=3.0), arm=arm), arm)


def test_shifts_and_turns_scatter_as_their_parameters_say(mount, forearm):
    effect = Misplaced(sigma_mm=2.0, sigma_deg=3.0)
    drawn = np.concatenate([displacements(mount(effect, seed=seed), forearm) for seed in range(20)])
    n = len(drawn)
    for values, sigma in zip(drawn.T, (2e-3, 2e-3, np.radians(3.0)), strict=True):
        assert abs(values.std() / sigma - 1.0) < 4.0 / np.sqrt(2 * n)
        assert abs(values.mean()) < 4.0 * sigma / np.sqrt(n)


def test_zero_shift_with_a_turn_keeps_the_centre(mount, forearm):
    geometry = mount(Misplaced(sigma_mm=0.0, sigma_deg=5.0))
    moved = displacements(geometry, forearm)
    np.testing.assert_allclose(moved[:, :2], 0.0, atol=1e-9)
    assert np.abs(moved[:, 2]).max() > 0.05


def test_geometry_of_the_arm_itself_is_not_touched(mount, forearm):
    before = forearm.tactel_s.copy()
    mount(Misplaced())
    np.testing.assert_array_equal(forearm.tactel_s, before)
    assert Geometry.of(forearm, discs=True).s is not forearm.tactel_s
