"""Touches over time and the loads of indenters."""

import numpy as np
import pytest

from skinbus.sim.indenter import Shape
from skinbus.sim.touch import Touch, TouchPlan


def touch(path, force, **more):
    return Touch(link=0, path=np.array(path, float), force=np.array(force, float), **more)


def test_touch_presses_from_its_first_to_its_last_force_key(pad):
    plan = TouchPlan(pad, [touch([[0, 0.02, 0.001]], [[1, 0], [2, 10], [3, 10], [3.5, 0]])])
    forces = {t: plan.at(t).force.tolist() for t in (0.5, 1.0, 1.5, 2.0, 2.7, 3.25, 3.5, 9.0)}
    assert forces == {0.5: [], 1.0: [], 1.5: [5.0], 2.0: [10.0], 2.7: [10.0], 3.25: [5.0], 3.5: [], 9.0: []}
    at = plan.at(2.0)
    assert (at.link[0], at.s[0], at.a[0], at.touch[0]) == (0, 0.02, 0.001, 0)


def test_path_runs_through_the_wrap_of_a_closed_surface(forearm):
    period = float(forearm.links[0].surface.period)
    path = [[0, 0.05, 0.45 * period], [1, 0.05, 0.55 * period]]
    plan = TouchPlan(forearm, [touch(path, [[0, 1], [2, 1]])])
    assert plan.at(0.25).a[0] == pytest.approx(0.475 * period)
    assert plan.at(0.75).a[0] == pytest.approx(-0.475 * period)
    assert plan.at(1.5).a[0] == pytest.approx(-0.45 * period), "after its last key a touch stays"


def test_contact_of_a_sphere_grows_by_the_law_of_hertz_up_to_its_own_radius(pad):
    sphere = {"shape": Shape.SPHERE, "length": 0.016, "modulus": 200e3}
    plan = TouchPlan(pad, [touch([[0, 0.02, 0.0]], [[0, 0], [100, 100]], **sphere)])
    radii = {force: float(plan.load(float(force)).radius[0]) for force in (1, 8, 90)}
    assert radii[1] == pytest.approx((0.75 * 1.0 * 0.008 / 200e3) ** (1 / 3))
    assert radii[8] == pytest.approx(2.0 * radii[1])
    assert radii[90] == pytest.approx(0.008, rel=1e-5)
