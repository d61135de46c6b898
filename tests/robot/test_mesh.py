"""Meshes from files: what is mended is said, what cannot be used is refused with every fault."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skinbus.errors import ConfigError
from skinbus.robot.mesh import MOST_TRIANGLES, load_mesh, mend
from tests.robot.meshes import sphere

trimesh = pytest.importorskip("trimesh", reason="extra skinbus[mesh]")


def faults(*mesh):
    with pytest.raises(ConfigError) as refused:
        mend(*mesh)
    return str(refused.value)


@pytest.mark.parametrize("kind", ["stl", "obj", "ply"])
def test_a_mesh_is_read_from_each_format(tmp_path, kind):
    points, triangles = sphere(80.0, 2)
    path = tmp_path / f"ball.{kind}"
    trimesh.Trimesh(points, triangles, process=False).export(path)
    mesh = load_mesh(path)
    assert (len(mesh.points), len(mesh.triangles)) == (162, 320)
    assert_allclose(np.linalg.norm(mesh.points, axis=1), 0.08, rtol=1e-6)
    middle = mesh.points[mesh.triangles].mean(axis=1)
    assert ((middle * mesh.normals()).sum(axis=1) > 0.0).all()


def test_an_inverted_surface_is_turned():
    points, triangles = sphere(0.08, 2)
    inverted = mend(points, triangles[:, ::-1])
    middle = inverted.points[inverted.triangles].mean(axis=1)
    assert ((middle * inverted.normals()).sum(axis=1) > 0.0).all()


def test_ill_meshes_are_refused():
    points, triangles = sphere(0.08, 2)
    n = len(points)
    fin = np.concatenate([points, [[0.2, 0.0, 0.0]]]), np.concatenate([triangles, [[*triangles[0, :2], n]]])
    assert "wanted at most two at an edge" in faults(*fin)
    flipped = np.concatenate([triangles[:9], triangles[9:, ::-1]])
    assert "surface: is 'flipped triangles, or one side only'" in faults(points, flipped)
    two = np.concatenate([points, points + 0.5]), np.concatenate([triangles, triangles + n])
    assert "parts: is 2; wanted one connected surface" in faults(*two)
    assert "say its unit" in faults(500.0 * points, triangles)
    assert "say its unit" in faults(1e-3 * points, triangles)
    assert "NaN" in faults(np.where(points == points[3], np.nan, points), triangles)
    assert "of points that there are" in faults(points, triangles + 1)
    assert "of points that there are" in faults(points, triangles[:0])
    many = np.tile(triangles, (MOST_TRIANGLES // 320 + 1, 1))
    assert f"wanted at most {MOST_TRIANGLES}" in faults(points, many)


def test_files_that_are_no_mesh_are_refused(tmp_path):
    for name, content in (
        ("a.stl", b"solid"),
        ("a.obj", b"v 0 0"),
        ("a.ply", b"ply\nnonsense"),
        ("a.step", b""),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ConfigError):
            load_mesh(tmp_path / name)
    with pytest.raises(ConfigError, match="can be read"):
        load_mesh(tmp_path / "none.stl")
