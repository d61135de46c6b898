"""shear: an inclined push, against a boundary solve in 60 digits, Cerruti's half-space, and Coulomb."""

import numpy as np
import pytest
from mpmath import exp, lu_solve, matrix, mp, mpf

from skinbus.config.system import load_arm
from skinbus.sim.bonded_layer import profile, transfer
from skinbus.sim.effects.mounting import Shear
from skinbus.sim.laws import Elastic
from skinbus.sim.sampler import Sampler
from skinbus.sim.scene import Scene
from skinbus.sim.touch import Touch


def solved(k, h, nu, y):
    """The four boundary conditions one by one, in 60 digits; potentials exp(-k (h - y)) and exp(-k y)."""
    k, h, nu, y = mpf(k), mpf(h), mpf(nu), mpf(y)

    def row(kind, at):
        waves = [(s, exp(-k * (h - at)) if s > 0 else exp(-k * at)) for s in (1, -1)]
        first = {
            "u": [k * v for s, v in waves],
            "w": [-s * k * v for s, v in waves],
            "normal": [-k * k * v for s, v in waves],
            "shear": [s * k * k * v for s, v in waves],
        }[kind]
        second = {
            "u": [at * k * v for s, v in waves],
            "w": [(3 - 4 * nu) * v - at * s * k * v for s, v in waves],
            "normal": [2 * (1 - nu) * s * k * v - at * k * k * v for s, v in waves],
            "shear": [-(1 - 2 * nu) * k * v + at * s * k * k * v for s, v in waves],
        }[kind]
        return first + second

    system = matrix([row("u", mpf(0)), row("w", mpf(0)), row("normal", h), row("shear", h)])
    constants = lu_solve(system, matrix([0, 0, 0, 1]))
    return float(sum(a * b for a, b in zip(row("normal", y), constants, strict=True)))


@pytest.mark.parametrize("nu", ["0", "0.3", "0.48", "0.4999"])
@pytest.mark.parametrize(("h", "depth"), [("0.006", "0.006"), ("0.02", "0.01"), ("0.001", "0.0005")])
def test_transfer_is_the_boundary_solve_in_sixty_digits(nu, h, depth):
    with mp.workdps(60):
        waves = [0.01, 1.0, 30.0, 100.0, 300.0, 1000.0, 4000.0]
        expected = [solved(k, h, nu, mpf(h) - mpf(depth)) for k in waves]
    given = transfer(waves, thickness=float(h), poisson=float(nu), depth=float(depth), tangential=True)
    np.testing.assert_allclose(given, expected, rtol=0, atol=1e-13)


def test_thick_layer_is_the_half_space_of_cerruti():
    z, d = 0.002, np.linspace(0.0, 0.02, 41)
    given = profile(d, thickness=0.2, poisson=0.3, depth=z, tangential=True)
    expected = 3.0 * d * z * z / (2.0 * np.pi * (d * d + z * z) ** 2.5)
    np.testing.assert_allclose(given, expected, atol=2e-4 * expected.max())


def pressures(pad, friction, **touch):
    touch = Touch(
        link=0,
        path=np.array([[0.0, 0.025, 0.0]]),
        force=np.array([[0.0, 8.0], [1.0, 8.0]]),
        **touch,
    )
    effects = [] if friction is None else [Shear(friction=friction)]
    scene = Scene("push", pad, duration_s=1.0, layer=Elastic(), touches=[touch], effects=effects)
    sampler = Sampler(scene)
    sampler.sample(0.5)
    return sampler.pressures.copy()


def test_push_adds_pressure_ahead_and_takes_as_much_away_behind():
    pad = load_arm("pad")
    board = pad.tactels_of(0)
    straight = pressures(pad, None, inclination=0.4)
    inclined = pressures(pad, 1.0, inclination=0.4)
    s, a = pad.tactel_s[board] - 0.025, pad.tactel_a[board]
    more = (inclined - straight)[board]
    assert (more[s > 1e-3] > 0.0).all()
    assert (more[s < -1e-3] < 0.0).all()
    d = np.hypot(s, a)
    k1 = profile(d, thickness=0.006, poisson=0.48, tactel_radius=0.5 * 9.53e-3, tangential=True)
    np.testing.assert_allclose(more, 0.4 * 8.0 * k1 * s / d, atol=2.0)


def test_push_slips_at_friction_and_sticks_below():
    pad = load_arm("pad")
    straight = pressures(pad, None)
    at = {mu: pressures(pad, mu, inclination=0.5, direction=1.0) - straight for mu in (0.0, 0.25, 0.5, 2.0)}
    assert not at[0.0].any()
    np.testing.assert_allclose(at[0.25], 0.5 * at[0.5], atol=1e-6)
    np.testing.assert_array_equal(at[2.0], at[0.5])
