"""The chart of a surface in kernels is that of the model."""

import numpy as np
import pytest
from numba import njit

from skinbus.estimate.kernels.geometry import LinkSurface, develop, separation, undevelop
from skinbus.model import Surface

SURFACES = [Surface.plane(1.0, 1.0), Surface.cylinder(0.3, 0.05), Surface.cone(0.3, 0.06, 0.03)]


@njit
def chart(on, s, a, s0, a0):
    """The squared distance, half its derivatives, developed coordinates, and these on the surface."""
    x, y = develop(on, s, a, a0)
    return *separation(on, s, a, s0, a0), x, y, *undevelop(on, x, y, a0)


@pytest.mark.parametrize("surface", SURFACES, ids=lambda surface: surface.kind)
def test_kernel_geometry_is_that_of_the_model(surface):
    rng, step = np.random.default_rng(5), 1e-7
    on = LinkSurface(surface.radius, surface.taper, surface.period, surface.length)
    for _ in range(200):
        (s, s0), (a, a0) = rng.uniform(0.02, 0.28, 2), rng.uniform(-0.14, 0.14, 2)
        d2, by_s, by_a, x, y, *again = chart(on, s, a, s0, a0)
        d, d_s, d_a = surface.distance(np.array([s, s + step, s]), np.array([a, a, a + step]), s0, a0)
        assert d2 == pytest.approx(d**2, rel=1e-12)
        assert np.array([by_s, by_a]) / d == pytest.approx((np.array([d_s, d_a]) - d) / step, abs=1e-4)
        assert np.allclose((x, y), surface.develop(s, a, a0), rtol=1e-12, atol=1e-15)
        assert again == pytest.approx([s, float(surface.wrap(a))], abs=1e-12)
