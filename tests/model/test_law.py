"""Contact laws: the cone's volume is its force, its inversion is exact, limits are sane."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbus.estimate import Estimator
from skinbus.model import Arm, Cone, Radial, grid

slopes = st.floats(1e4, 1e8)
forces = st.floats(1e-3, 1e3)


@given(slopes, forces)
def test_force_is_the_volume_under_the_cone(slope, force):
    cone = Cone(slope)
    with mpmath.workdps(30):
        height, reach = mpmath.mpf(float(cone.height(force))), mpmath.mpf(float(cone.reach(force)))
        volume = mpmath.quad(lambda d: 2 * mpmath.pi * d * (height - slope * d), [0, reach])
    assert float(volume) == pytest.approx(force, rel=1e-12)


@given(slopes, forces)
def test_height_and_reach_are_those_of_the_paper(slope, force):
    cone = Cone(slope)
    with mpmath.workdps(30):
        reach = (3 * mpmath.mpf(force) / (mpmath.pi * slope)) ** (mpmath.mpf(1) / 3)
        height = slope * reach
    assert cone.reach(force) == pytest.approx(float(reach), rel=1e-14)
    assert cone.height(force) == pytest.approx(float(height), rel=1e-14)


@given(slopes, forces, st.floats(0.0, 0.999))
def test_force_inverts_pressure_wherever_the_contact_presses(slope, force, share):
    cone = Cone(slope)
    d = share * float(cone.reach(force))
    assert cone.force(cone.pressure(d, force), d) == pytest.approx(force, rel=1e-12)


TABLE = np.array([100.0, 60.0, 10.0, -2.0])


def test_radial_law_goes_through_its_points_and_ends_with_its_table():
    law = Radial(0.001, TABLE)
    assert law.pressure([0.0, 0.001, 0.002, 0.003, 0.0031], 2.0) == pytest.approx(
        [200.0, 120.0, 20.0, -4.0, 0.0]
    )
    assert law.reach([1.0, 5.0]) == pytest.approx([0.003, 0.003])


def test_radial_law_is_smooth_and_flat_at_its_peak():
    law = Radial(0.001, TABLE)
    h = 1e-9
    for d in (0.001, 0.002):  # the slope is the same on both sides of a point
        left = (law.profile(d) - law.profile(d - h)) / h
        right = (law.profile(d + h) - law.profile(d)) / h
        assert float(right) == pytest.approx(float(left), rel=1e-4)
    assert float(law.profile(h) - law.profile(0.0)) == pytest.approx(0.0, abs=1e-6)


@given(forces, st.floats(0.0, 0.0029), st.floats(0.3, 1.5))
def test_radial_force_inverts_pressure_where_the_profile_is_positive(force, d, exponent):
    law = Radial(0.001, TABLE, exponent)
    if float(law.profile(d)) > 1.0:
        assert law.force(law.pressure(d, force), d) == pytest.approx(force, rel=1e-9)


@given(slopes, forces, st.floats(0.3, 1.5), st.floats(0.0, 0.99))
def test_force_exponent_bends_the_cone_and_inverts_too(slope, force, exponent, share):
    cone = Cone(slope, exponent)
    assert cone.height(force) == pytest.approx(float(Cone(slope).height(force**exponent)), rel=1e-12)
    d = share * float(cone.reach(force))
    assert cone.force(cone.pressure(d, force), d) == pytest.approx(force, rel=1e-9)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Cone(0.0),
        lambda: Cone(1e250),
        lambda: Cone(1.0, -1.0),
        lambda: Cone(1.0, 1e3),
        lambda: Cone(misfit=np.inf),
        lambda: Radial(0.0, TABLE),
        lambda: Radial(1e150, TABLE),
        lambda: Radial(0.001, 1e200 * TABLE),
        lambda: Radial(0.001, np.ma.masked_array(TABLE, [False, True, False, False])),
        lambda: Radial(0.001, TABLE, misfit_profile=np.array([1.0, np.nan, 0.0, 0.0])),
    ],
)
def test_what_is_beyond_the_limits_is_refused(make):
    with pytest.raises(ValueError, match=r"must be from .* to .*, none masked; got"):
        make()


@pytest.mark.parametrize("slope", [1e-30, 1e30])
def test_contacts_at_the_limits_of_a_law_have_finite_covariances(slope):
    estimator = Estimator(Arm.single_patch(grid(4, 4, 0.01), law=Cone(slope)), "fit")
    for k, pressures in enumerate((np.full(16, 5e4), 1e4 * np.arange(16.0))):
        contacts = estimator.update(pressures, 20_000_000 * k)
        assert np.isfinite(contacts.covariance).all()
