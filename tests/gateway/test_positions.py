"""Points laid flat keep the lengths of the surface that they are on."""

import numpy as np
import pytest

from skinbus.gateway.positions import lay_flat
from skinbus.model import Surface, grid

UV = grid(5, 5, 7e-3)
"""Its middle tactel is its centre."""


def on(surface, s, a):
    return surface.position(s + UV[:, 0], a + UV[:, 1])


@pytest.mark.parametrize(
    ("surface", "a"),
    [(Surface.plane(0.2, 0.2), 0.01), (Surface.cylinder(0.2, 0.03), 0.05), (Surface.cylinder(0.2, 2.0), 0.0)],
    ids=["plane", "cylinder", "nearly flat"],
)
def test_a_board_on_plane_or_cylinder_has_the_lengths_of_its_chart(surface, a):
    points, normals = on(surface, 0.1, a)
    flat = lay_flat(points, 3.0 * normals)
    assert flat.uv == pytest.approx(UV, abs=1e-12)
    assert flat.centre == pytest.approx(points[12], abs=1e-12)
    assert flat.along == pytest.approx([1.0, 0.0, 0.0])


def test_on_a_sphere_each_tactel_keeps_its_distance_from_the_middle():
    d, radius = np.linalg.norm(UV, axis=1), 0.04
    ahead = UV / np.maximum(d, 1e-12)[:, None]
    normals = np.column_stack([np.sin(d / radius)[:, None] * ahead, np.cos(d / radius)])
    assert lay_flat(radius * normals, normals).uv == pytest.approx(UV, abs=1e-12)


def test_a_board_that_faces_along_x_has_u_along_y():
    points = np.column_stack([np.zeros(25), UV])
    flat = lay_flat(points, np.tile([1.0, 0.0, 0.0], (25, 1)))
    assert flat.uv == pytest.approx(UV)
    assert flat.along == pytest.approx([0.0, 1.0, 0.0])


@pytest.mark.parametrize("normal", [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
def test_a_normal_that_cannot_be_is_refused_by_its_number(normal):
    points, normals = on(Surface.plane(0.2, 0.2), 0.1, 0.0)
    normals[3] = normal
    with pytest.raises(ValueError, match="normal 4"):
        lay_flat(points, normals)
