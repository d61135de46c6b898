"""The cone as a layer law against model.law.Cone."""

import numpy as np
from numpy.testing import assert_allclose

from skinbus.model import Cone
from skinbus.sim.laws import ConeLaw
from skinbus.sim.layer import Geometry, Loads


def one_load(s, a, force):
    loads = Loads(1)
    loads.n, loads.s[0], loads.a[0], loads.force[0] = 1, s, a, force
    return loads


def pressures_of(arm, geometry, loads):
    pressures = np.zeros(arm.n_tactels)
    ConeLaw(geometry).add(loads, pressures)
    return pressures


def test_point_tactels_read_the_cone_of_the_model(forearm):
    surface = forearm.links[0].surface
    seam = surface.period / 2
    seen = pressures_of(forearm, Geometry.of(forearm, discs=False), one_load(0.055, seam, 8.0))
    d = surface.distance(forearm.tactel_s, forearm.tactel_a, 0.055, -seam)
    assert_allclose(seen, Cone().pressure(d, 8.0), atol=1e-6)
    assert (seen > 0).any()
