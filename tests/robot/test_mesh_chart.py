"""Charts of meshes against geodesics that know nothing of meshes: shot over the smooth surface itself."""

import numpy as np
import pytest

from skinbus.model import Surface
from skinbus.robot.mesh import Mesh, mend
from skinbus.robot.mesh_chart import chart_at
from tests.robot.geodesics import EDGE, SURFACES, shoot
from tests.robot.meshes import tube

pytest.importorskip("potpourri3d", reason="extra skinbus[mesh]")


@pytest.mark.parametrize("name", SURFACES)
def test_charts_are_within_a_percent_of_geodesics_to_40_mm_and_a_tenth_of_a_millimetre_to_20(name):
    (points, triangles), slope = SURFACES[name]
    mesh = Mesh(points, triangles)
    rng = np.random.default_rng(31)
    for _ in range(2):
        near = mesh.points[rng.integers(len(mesh.points))]
        centre = mesh.points[
            mesh.triangles[
                (mesh.triangles == np.argmin(np.linalg.norm(mesh.points - near, axis=1))).any(axis=1)
            ][0]
        ].mean(axis=0)
        normal = slope(centre)[0]
        normal /= np.linalg.norm(normal)
        along = np.cross(normal, rng.standard_normal(3))
        along /= np.linalg.norm(along)
        across = np.cross(normal, along)
        chart = chart_at(mesh, centre, along)
        for length in (0.005, 0.02, 0.04):
            for angle in rng.uniform(0.0, 2.0 * np.pi, 8):
                direction = np.cos(angle) * along + np.sin(angle) * across
                place = shoot(slope, centre, direction, length)
                found = chart.locate(place[None])[0]
                off = abs(np.linalg.norm(found) - length)
                assert off < (1e-4 if length <= 0.02 else 0.01 * length)
                # and the direction: a tenth of a millimetre across at 5 and 20 mm, a percent at 40
                expected = length * np.array([np.cos(angle), np.sin(angle)])
                assert np.linalg.norm(found - expected) < (2e-4 if length <= 0.02 else 0.01 * length)


@pytest.mark.slow
def test_the_chart_of_a_tube_is_its_development_and_boards_lie_on_it():
    surface = Surface.cylinder(0.2, 0.05)
    mesh = mend(*tube(0.05, 0.2, EDGE))
    s0, a0 = 0.08, 0.4 * surface.radius
    centre = surface.position(s0, a0)[0]
    chart = chart_at(mesh, centre, [1.0, 0.0, 0.0])
    rng = np.random.default_rng(32)
    s, a = s0 + rng.uniform(-0.04, 0.04, 200), a0 + rng.uniform(-0.04, 0.04, 200)
    points, normals = surface.position(s, a)
    expected = np.stack([s - s0, a - a0], -1)
    near = np.linalg.norm(expected, axis=1) < 0.04
    off = np.linalg.norm(chart.locate(points[near]) - expected[near], axis=1)
    assert np.sqrt((off**2).mean()) < 5e-5
    assert off.max() < 2e-4
    lifted, outward = chart.lift(expected[near])
    sagitta = EDGE**2 / (8.0 * 0.05)
    assert np.linalg.norm(lifted - points[near], axis=1).max() < 2e-4 + sagitta
    assert ((outward * normals[near]).sum(axis=1) > np.cos(0.02)).all()
    assert np.isnan(chart.lift([[0.5, 0.0]])[0]).all()


def test_a_chart_is_kept_by_its_content(tmp_path, monkeypatch):
    mesh = mend(*tube(0.05, 0.2, 8e-3))
    where = [0.1, 0.0, 0.05], [1.0, 0.0, 0.0]
    first = chart_at(mesh, *where, kept=tmp_path)
    (file,) = tmp_path.iterdir()
    monkeypatch.setattr("skinbus.robot.mesh_chart._compute", None)
    np.testing.assert_array_equal(chart_at(mesh, *where, kept=tmp_path).uv, first.uv)
    monkeypatch.undo()
    chart_at(mesh, where[0], [1.0, 0.1, 0.0], kept=tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
    file.write_bytes(b"damaged")
    np.testing.assert_array_equal(chart_at(mesh, *where, kept=tmp_path).uv, first.uv)


def test_wrong_places_are_refused():
    mesh = mend(*tube(0.05, 0.2, 8e-3))
    with pytest.raises(ValueError, match="along the normal"):
        chart_at(mesh, mesh.points[mesh.triangles[50]].mean(axis=0), mesh.normals[50])
    with pytest.raises(ValueError, match="three numbers"):
        chart_at(mesh, [0.1, np.nan, 0.0], [1.0, 0.0, 0.0])
