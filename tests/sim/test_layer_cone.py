"""The cone as a layer law against model.law.Cone."""

import numpy as np
from scipy.integrate import dblquad

from skinbus.model import Cone
from skinbus.sim.layer import Geometry, Loads
from skinbus.sim.layer_cone import ConeLaw


def one_load(s, a, force):
    loads = Loads(1)
    loads.n, loads.s[0], loads.a[0], loads.force[0] = 1, s, a, force
    return loads


def pressures_of(arm, geometry, loads, **settings):
    pressures = np.zeros(arm.n_tactels)
    ConeLaw(geometry, **settings).add(loads, pressures)
    return pressures


def test_point_tactels_read_the_cone_of_the_model(ring_arm):
    surface = ring_arm.links[0].surface
    seam = surface.period / 2
    seen = pressures_of(ring_arm, Geometry.of(ring_arm, discs=False), one_load(0.055, seam, 8.0))
    d = surface.distance(ring_arm.tactel_s, ring_arm.tactel_a, 0.055, -seam)
    np.testing.assert_allclose(seen, Cone().pressure(d, 8.0), atol=1e-6)
    assert (seen > 0).any()


def test_disc_tactels_read_the_mean_of_the_cone_over_their_disc(pad_arm):
    geometry = Geometry.of(pad_arm, discs=True)
    s, a, force, slope = 0.027, 0.0013, 5.0, 4e6
    seen = pressures_of(pad_arm, geometry, one_load(s, a, force), slope=slope)
    radius = 0.5 * geometry.diameter[0]
    cone = Cone(slope)
    for i in (0, 5, 6, 10):
        x, y = geometry.s[i] - s, geometry.a[i] - a

        def ring(angle, r, x=x, y=y):
            d = np.hypot(x + r * np.cos(angle), y + r * np.sin(angle))
            return float(cone.pressure(d, force)) * r

        wanted = dblquad(ring, 0.0, radius, 0.0, 2.0 * np.pi, epsrel=1e-4)[0] / (np.pi * radius**2)
        assert abs(seen[i] - wanted) < 5e-3 * cone.height(force)
