"""The contact laws in kernels are those of the model."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from skinbus.estimate.kernels import law as laws_of_kernels
from skinbus.estimate.kernels.layout import compile_layout
from skinbus.model import Arm, Cone, Radial, grid
from tests.inner_kernels import from_python

amplitude, log_force_of = from_python(laws_of_kernels.amplitude), from_python(laws_of_kernels.log_force_of)
pressure, reach = from_python(laws_of_kernels.pressure), from_python(laws_of_kernels.reach)

SLOPES = [1e-3, 1.2e6, 4e6, 1e12]


RADIAL = Radial(0.5e-3, np.exp(-0.5 * (np.arange(50) * 0.5 / 5.0) ** 2) * 3e3 - 30.0)


@pytest.mark.parametrize("slope", SLOPES)
@pytest.mark.parametrize("force", [1e-6, 5.0, 1e4])
def test_the_volume_of_the_cone_is_the_force(slope, force):
    cone = Cone(slope)
    radius = float(cone.reach(force))
    volume = quad(lambda x: 2.0 * math.pi * x * float(cone.pressure(x * radius, force)), 0.0, 1.0)[0]
    assert volume * radius**2 == pytest.approx(force, rel=1e-9)


@pytest.mark.parametrize(
    "law", [*map(Cone, SLOPES), Cone(1.2e6, 0.8), RADIAL, Radial(1e-3, RADIAL.table, 0.7)]
)
def test_force_inverts_pressure(law):
    for force in (0.01, 5.0, 40.0):
        for share in (0.0, 0.3, 0.6):
            d = share * float(law.reach(force))
            assert float(law.force(law.pressure(d, force), d)) == pytest.approx(force, rel=1e-9)


@pytest.mark.parametrize("law", [Cone(1.2e6), Cone(4e6, 0.8), RADIAL, Radial(0.5e-3, RADIAL.table, 0.7)])
def test_kernels_and_model_are_one_law(law):
    lay = compile_layout(Arm.single_patch(grid(2, 2, 0.01), law=law, size=(0.05, 0.05)))
    laws, tables = lay.law_par, lay.law_table
    for force in (0.3, 5.0):
        amp, slope = amplitude(laws, 0, math.log(force))
        assert log_force_of(laws, 0, amp) == pytest.approx(math.log(force), abs=1e-12)
        assert slope == pytest.approx((amplitude(laws, 0, math.log(force) + 1e-6)[0] - amp) / 1e-6, rel=1e-5)
        assert reach(laws, 0, amp) == pytest.approx(float(law.reach(force)), rel=1e-12)
        for d in np.linspace(0.0, 0.99, 40) * float(law.reach(force)):
            p, p_d, p_amp = pressure(laws, tables, 0, amp, d)
            assert p == pytest.approx(float(law.pressure(d, force)), rel=1e-9, abs=1e-9)
            step = 1e-8
            assert p_d == pytest.approx(
                (pressure(laws, tables, 0, amp, d + step)[0] - p) / step, rel=1e-3, abs=50.0
            )
            assert p_amp == pytest.approx(
                (pressure(laws, tables, 0, amp * 1.0001, d)[0] - p) / (amp * 1e-4), rel=1e-6
            )


def test_a_law_out_of_range_is_refused():
    for wrong in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="slope"):
            Cone(wrong)
    with pytest.raises(ValueError, match="table"):
        Radial(1e-3, np.array([0.0, 1.0]))
