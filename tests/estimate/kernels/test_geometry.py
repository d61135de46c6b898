"""The chart of a surface in kernels is that of the model."""

import math

import numpy as np
import pytest

from skinbus.estimate.kernels import geometry
from skinbus.estimate.kernels.geometry import LinkSurface
from skinbus.model import Surface
from tests.inner_kernels import from_python

distance, separation = from_python(geometry.distance), from_python(geometry.separation)
develop, undevelop = from_python(geometry.develop), from_python(geometry.undevelop)

SURFACES = [Surface.plane(1.0, 1.0), Surface.cylinder(0.3, 0.05), Surface.cone(0.3, 0.06, 0.03)]


@pytest.mark.parametrize("surface", SURFACES, ids=lambda surface: surface.kind)
def test_kernel_geometry_is_that_of_the_model(surface):
    rng = np.random.default_rng(5)
    on = LinkSurface(surface.radius, surface.taper, surface.period, surface.length)
    for _ in range(200):
        s1, s2 = rng.uniform(0.02, 0.28, 2)
        a1, a2 = rng.uniform(-0.14, 0.14, 2)
        d2, x, y = separation(on, s1, a1, s2, a2)
        d = math.sqrt(d2)
        d_s, d_a = x / d, y / d
        assert d == pytest.approx(float(surface.distance(s1, a1, s2, a2)), rel=1e-12)
        assert d == pytest.approx(distance(on, s1, a1, s2, a2), rel=1e-12)
        step = 1e-7
        assert d_s == pytest.approx((distance(on, s1 + step, a1, s2, a2) - d) / step, abs=1e-4)
        assert d_a == pytest.approx((distance(on, s1, a1 + step, s2, a2) - d) / step, abs=1e-4)
        x, y = develop(on, s1, a1, a2)
        assert np.allclose((x, y), surface.develop(s1, a1, a2), rtol=1e-12, atol=1e-15)
        back = undevelop(on, x, y, a2)
        assert back[0] == pytest.approx(s1, abs=1e-12)
        assert float(surface.wrap(back[1] - a1)) == pytest.approx(0.0, abs=1e-12)
