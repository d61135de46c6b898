"""The cone as a layer law against model.law.Cone."""

import numpy as np
from numpy.testing import assert_allclose

from skinbus.model import Cone
from skinbus.sim.laws import ConeSettings
from tests.skins import feel_of


def test_point_tactels_read_the_cone_of_the_model(forearm):
    surface = forearm.links[0].surface
    seam = surface.period / 2
    seen = feel_of(forearm, ConeSettings(), 0.0)(np.array([[0.055, seam, 8.0]]))
    d = surface.distance(forearm.tactel_s, forearm.tactel_a, 0.055, -seam)
    assert_allclose(seen, Cone().pressure(d, 8.0), atol=1e-6)
    assert (seen > 0).any()
