"""shear: what an inclined push adds, and friction; its layer is in ``tests/sim/test_layer_elastic.py``."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from skinbus.config.system import load_arm
from skinbus.sim.bonded_layer import profile
from skinbus.sim.effects.mounting import Shear
from skinbus.sim.laws import Elastic
from skinbus.sim.sampler import Sampler
from skinbus.sim.scene import Scene
from skinbus.sim.touch import Touch


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
    assert_allclose(more, 0.4 * 8.0 * k1 * s / d, atol=2.0)


def test_push_slips_at_friction_and_sticks_below():
    pad = load_arm("pad")
    straight = pressures(pad, None)
    at = {mu: pressures(pad, mu, inclination=0.5, direction=1.0) - straight for mu in (0.0, 0.25, 0.5, 2.0)}
    assert not at[0.0].any()
    assert_allclose(at[0.25], 0.5 * at[0.5], atol=1e-6)
    assert_array_equal(at[2.0], at[0.5])
