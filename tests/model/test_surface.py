"""Charts of surfaces: isometry, inverse, oracle in many digits, limits, wrap."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from skinbus.model import Surface

PLANE = Surface.plane(0.3, 0.2)
TUBE = Surface.cylinder(0.3, 0.06)
CONE = Surface.cone(0.3, 0.08, 0.05)
WIDENING = Surface.cone(0.1, 0.04, 0.09)
ALL = [PLANE, TUBE, CONE, WIDENING]

ROUNDING = 1e-13
"""Metres; lengths here are below 1 m, and a dozen operations lose a few units of 2e-16 each."""

lengths = st.floats(0.0, 1.0)
turns = st.floats(-0.5, 0.5)
tapers = st.one_of(st.floats(-0.6, 0.6), st.floats(-1e-6, 1e-6), st.just(0.0))


@st.composite
def surfaces(draw):
    length, taper = draw(st.floats(0.05, 0.5)), draw(tapers)
    middle = draw(st.floats(0.04, 0.2)) + 0.5 * length * abs(taper)
    change = 0.5 * length * taper
    if taper == 0.0:
        return Surface.cylinder(length, middle)
    return Surface.cone(length, middle - change, middle + change)


def point(surface, s, a):
    return s * surface.length, a * surface.period


@given(surfaces(), lengths, turns, turns)
def test_undevelop_inverts_develop(surface, s, a, a0):
    s, a = point(surface, s, a)
    a0 *= surface.period
    back_s, back_a = surface.undevelop(*surface.develop(s, a, a0), a0)
    assert back_s == pytest.approx(s, abs=ROUNDING)
    assert surface.wrap(back_a - a) == pytest.approx(0.0, abs=ROUNDING)


def oracle_distance(surface, s1, a1, s2, a2):
    """Return the geodesic distance from the law of cosines about the apex, in 50 digits."""
    with mpmath.workdps(50):
        taper = mpmath.mpf(surface.taper)
        radius, half = mpmath.mpf(surface.radius), mpmath.mpf(surface.length) / 2
        angle = (mpmath.mpf(a1) - mpmath.mpf(a2)) / radius
        angle -= 2 * mpmath.pi * mpmath.nint(angle / (2 * mpmath.pi))
        if taper == 0:
            return float(mpmath.hypot(s1 - s2, radius * angle))
        rho1, rho2 = (radius / taper + mpmath.mpf(s) - half for s in (s1, s2))
        squared = rho1**2 + rho2**2 - 2 * rho1 * rho2 * mpmath.cos(angle * taper)
        return float(mpmath.sqrt(mpmath.fabs(squared)))


@given(surfaces(), lengths, st.floats(-3.5, 3.5), lengths, turns)
def test_distance_agrees_with_the_law_of_cosines_in_50_digits(surface, s1, a1, s2, a2):
    s1, a1 = point(surface, s1, a1)
    s2, a2 = point(surface, s2, a2)
    expected = oracle_distance(surface, s1, a1, s2, a2)
    assert surface.distance(s1, a1, s2, a2) == pytest.approx(expected, rel=1e-12, abs=ROUNDING)


@pytest.mark.parametrize("surface", ALL, ids=lambda s: f"{s.kind} {s.taper:g}")
def test_small_steps_on_the_chart_are_as_long_in_space(surface):
    s, a = np.meshgrid(np.linspace(0.1, 0.9, 5) * surface.length, np.linspace(-0.4, 0.4, 7) * surface.width)
    step = 1e-5
    for direction in np.linspace(0.0, math.tau, 8, endpoint=False):
        # a is measured at the reference radius
        across = step * math.sin(direction) * surface.radius / surface.radius_at(s)
        s2, a2 = s + step * math.cos(direction), a + across
        p, _ = surface.position(s, a)
        q, _ = surface.position(s2, a2)
        chord = np.linalg.norm(q - p, axis=-1)
        bend = step**3 / 0.04**2  # the chord is shorter than the arc by step^3 / (24 r^2)
        assert_allclose(chord, surface.distance(s, a, s2, a2), atol=bend + 1e-15)
        assert_allclose(chord, step, rtol=1e-3)


@pytest.mark.parametrize("surface", ALL, ids=lambda s: f"{s.kind} {s.taper:g}")
def test_normal_is_a_unit_vector_right_handed_with_s_and_a(surface):
    s, a = np.meshgrid(np.linspace(0.1, 0.9, 5) * surface.length, np.linspace(-0.5, 0.5, 9) * surface.width)
    h = 1e-6
    _, n = surface.position(s, a)
    along = surface.position(s + h, a)[0] - surface.position(s - h, a)[0]
    across = surface.position(s, a + h)[0] - surface.position(s, a - h)[0]
    cross = np.cross(along, across)
    cross /= np.linalg.norm(cross, axis=-1, keepdims=True)
    assert_allclose(np.linalg.norm(n, axis=-1), 1.0, atol=1e-14)
    assert_allclose(n, cross, atol=1e-8)


@given(surfaces(), st.floats(0.05, 0.95), st.floats(-0.49, 0.49), st.floats(-0.01, 0.02))
def test_point_over_the_surface_is_projected_to_its_foot_and_height(surface, s, a, height):
    s, a = point(surface, s, a)
    foot, normal = surface.position(s, a)
    found = surface.project((foot + height * normal)[None])
    assert_allclose(np.ravel(found), [s, a, height], atol=1e-12)
