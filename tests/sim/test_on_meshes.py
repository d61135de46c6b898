"""Loads on meshes press on tactels at their geodesic distance, by another way than that of the estimator."""

import numpy as np
import pytest

from skinbus.sim import Scene
from skinbus.sim.indenter import Shape
from skinbus.sim.laws import ConeSettings, Elastic
from skinbus.sim.sampler import Sampler
from skinbus.sim.touch import Touch
from tests.robot.mesh_arms import tube_arms

pytest.importorskip("potpourri3d", reason="extra skinbus[mesh]")


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
