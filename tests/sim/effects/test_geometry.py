"""Every effect by itself: what effects make of where tactels are and how they respond."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skinbus.config.system import load_arm
from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface, grid
from skinbus.sim.effect import stream
from skinbus.sim.effects.mounting import PROFILE, Misplaced, Response
from skinbus.sim.indenter import Indenter
from skinbus.sim.laws import Elastic
from skinbus.sim.layer import Geometry, Loads

# --- misplaced: boards move as rigid bodies on the surface, by as much as they should.


def displacements(geometry, arm):
    """Return (ds, da, turn) of each patch, from its tactels on the development as complex numbers."""
    out = []
    for p, placed in enumerate(arm.patches):
        at, surface = arm.tactels_of(p), arm.links[placed.link].surface
        before, after = (
            [1.0, 1j] @ np.array(surface.develop(s[at], a[at], placed.a))
            for s, a in ((arm.tactel_s, arm.tactel_a), (geometry.s, geometry.a))
        )
        shift = after.mean() - before.mean()
        x, y = before - before.mean(), after - after.mean()
        assert_allclose(np.abs(x), np.abs(y), atol=1e-9)
        out.append((shift.real, shift.imag, np.angle(np.vdot(x, y))))
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


# --- response: tactels that differ by the figures that are asked for, about the layer's own table.


QUIET = {"gain": 0.0, "width": 0.0, "ellipse": 1.0, "offset_pa": 0.0, "residual": 0.0}
PATCH = Patch(tactels_uv=grid(8, 8, 6.25e-3), size=(0.06, 0.06))
ARM = Arm(
    "board",
    [Link("board", Surface.plane(0.06, 0.06))],
    [PlacedPatch(patch=PATCH, node_id=1, link=0, s=0.03, a=0.0)],
)


def readings(effect, places, seed=7):
    """Return the pressures (n_places, n_tactels) Pa under a newton at each place (n, 2) m."""
    geometry = Geometry.of(ARM, discs=False)
    effect.bind(ARM, stream(seed, "response"))(geometry)
    law = Elastic().bind(geometry, [Indenter()])
    out = np.zeros((len(places), ARM.n_tactels))
    for row, (s, a) in zip(out, places, strict=True):
        law.add(Loads(1, s=s, a=a, force=1.0), row)
    return out


def over_tactels():
    return np.column_stack([ARM.tactel_s, ARM.tactel_a])


def test_gain_multiplies_all_that_a_tactel_reads():
    at = over_tactels()
    plain, spread = readings(Response(**QUIET), at), readings(Response(**{**QUIET, "gain": 0.1}), at)
    own = np.diag(spread) / np.diag(plain)
    assert_allclose(spread, plain * own, rtol=1e-9)
    assert abs(own.std() / 0.1 - 1.0) < 0.25


@pytest.mark.slow
def test_width_and_ellipse_keep_the_force_that_a_tactel_sees():
    x = np.arange(-30e-3, 30.1e-3, 1e-3)
    grid_of_loads = np.array([[0.03 + u, v] for u in x for v in x])
    middle = int(np.argmin(np.hypot(ARM.tactel_s - 0.03, ARM.tactel_a)))
    centre = over_tactels()[middle]
    places = grid_of_loads - [0.03, 0.0] + centre
    plain = readings(Response(**QUIET), places)[:, middle]
    for changed in ({"width": 0.08}, {"ellipse": 1.1}):
        other = readings(Response(**{**QUIET, **changed}), places)[:, middle]
        assert abs(other.sum() / plain.sum() - 1.0) < 6e-3, (
            "what the table is cut by counts in one of the two"
        )
        assert np.abs(other - plain).max() > 0.005 * plain.max()


@pytest.mark.slow
def test_residual_has_its_profile_over_distance():
    rng = np.random.default_rng(3)
    places = np.column_stack([rng.uniform(0.0, 0.06, 1500), rng.uniform(-0.03, 0.03, 1500)])
    plain = readings(Response(**QUIET), places)
    with_it = readings(Response(**{**QUIET, "residual": 0.009}), places)
    d = np.hypot(places[:, :1] - ARM.tactel_s, places[:, 1:] - ARM.tactel_a)
    peak = readings(Response(**QUIET), over_tactels()).max()
    for at, share in PROFILE.T[1:6]:
        near = np.abs(d - at) < 0.4e-3
        assert abs((with_it - plain)[near].std() / (0.009 * share * peak) - 1.0) < 0.3, at
