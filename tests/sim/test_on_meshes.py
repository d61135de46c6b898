"""Loads on meshes press on tactels at their geodesic distance, by another way than that of the estimator."""

import numpy as np
import pytest

from skinbus.model import Surface
from skinbus.sim import Scene
from skinbus.sim.indenter import Shape
from skinbus.sim.laws import ConeSettings, Elastic
from skinbus.sim.layer import seen_from
from skinbus.sim.sampler import Sampler
from skinbus.sim.touch import Touch
from tests.robot.mesh_arms import tube_arms

pytest.importorskip("potpourri3d", reason="extra skinbus[mesh]")


@pytest.mark.parametrize("surface", [Surface.cylinder(0.3, 0.04), Surface.cone(0.3, 0.05, 0.04)])
def test_points_are_seen_at_their_geodesic_distance_and_in_their_direction(surface):
    rng = np.random.default_rng(3)
    for _ in range(20):
        s, a = 0.15, rng.uniform(-0.1, 0.1)
        x, y = rng.uniform(-0.025, 0.025, (2, 50))
        x0, y0 = surface.develop(s, a, a)
        there = surface.undevelop(x0 + x, y0 + y, a)
        (point,), (normal,) = surface.position([s], [a])
        ends = surface.position(*surface.undevelop(x0 + np.array([-1e-5, 1e-5]), y0 + np.zeros(2), a))[0]
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        seen = seen_from(point, normal, along, *surface.position(*there))
        assert np.hypot(*seen.T) == pytest.approx(np.hypot(x, y), rel=3e-3)
        # a chord is turned against the geodesic by up to a twelfth of the squared angle that it spans
        assert (np.hypot(*(seen.T - (x, y))) < 0.05 * np.hypot(x, y)).all()


@pytest.mark.parametrize(
    ("layer", "shape"), [(Elastic(), "DISC"), (ConeSettings(), "POINT"), (Elastic(), "PALM")]
)
def test_a_scene_on_the_mesh_of_a_cylinder_presses_as_on_the_cylinder(layer, shape):
    rng = np.random.default_rng(11)
    flat, mesh = tube_arms()
    places = rng.uniform((0.06, -0.157), (0.14, 0.157), (6, 2))
    pressures = []
    for arm in (flat, mesh):
        surface = arm.links[0].surface
        touches = []
        for s, a in places:
            if arm is mesh:
                (s,), (a,), _ = surface.project(flat.links[0].surface.position(s, a)[0][None])
            force = np.array([[0.0, 8.0], [1.0, 8.0]])
            sizes = {"DISC": {"length": 0.012}, "PALM": {"length": 0.06, "width": 0.04}}.get(shape, {})
            path = np.array([[0.0, s, a]])
            touches.append(Touch(link=0, path=path, force=force, shape=Shape[shape], **sizes))
        sampler = Sampler(Scene("six", arm, duration_s=1.0, layer=layer, touches=touches))
        sampler.sample(0.5)
        pressures.append(sampler.pressures.copy())
    one, other = pressures
    assert one.max() > 10e3
    assert np.abs(other - one).max() < 0.01 * one.max()
    assert other.sum() == pytest.approx(one.sum(), rel=3e-3)
