"""Boards on meshes share one chart: exact where the mesh can be unrolled, measured where it cannot."""

import numpy as np
import pytest

from skinbus.errors import ConfigError
from skinbus.model import Cone, Patch, PlacedPatch, grid
from skinbus.robot.flattening import flatten
from skinbus.robot.mesh import Mesh, mend
from skinbus.robot.mesh_link import Laid, lay
from tests.robot.geodesics import SURFACES, shoot
from tests.robot.mesh_arms import mesh_arm, tube_arms
from tests.robot.meshes import sphere, tube

pytestmark = pytest.mark.slow

pytest.importorskip("potpourri3d", reason="extra skinbus[mesh]")

UV = grid(4, 4, 0.010)
RADIUS = 0.05


@pytest.fixture
def arms():
    return tube_arms()


def test_boards_around_a_tube_have_the_distances_and_places_that_they_have_on_the_cylinder(arms):
    flat, mesh = arms
    cylinder, surface = (arm.links[0].surface for arm in arms)
    assert surface.period == pytest.approx(cylinder.period, rel=5e-4)  # of a polygon of 105 corners
    assert mesh.tactel_width == pytest.approx(1.0, abs=1e-9)
    true = cylinder.distance(flat.tactel_s[:, None], flat.tactel_a[:, None], flat.tactel_s, flat.tactel_a)
    got = surface.distance(mesh.tactel_s[:, None], mesh.tactel_a[:, None], mesh.tactel_s, mesh.tactel_a)
    near = true < 0.06
    assert np.abs(got - true)[near].max() < 0.03e-3
    point, normal = surface.position(mesh.tactel_s, mesh.tactel_a)
    true_point, true_normal = cylinder.position(flat.tactel_s, flat.tactel_a)
    assert np.linalg.norm(point - true_point, axis=1).max() < 0.05e-3
    assert np.abs(normal - true_normal).max() < 1e-3


def boards_around(mesh, direction):
    """Four boards side by side where a mesh is farthest in a direction."""
    middles = mesh.points[mesh.triangles].mean(axis=1)
    top = int((middles @ direction).argmax())
    along = np.cross(mesh.normals()[top], [0.3, 1.0, 0.2])
    along /= np.linalg.norm(along)
    across = np.cross(mesh.normals()[top], along)
    laid = []
    for u, v in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        wanted = middles[top] + 0.0255 * (u * along + v * across)
        point = middles[np.linalg.norm(middles - wanted, axis=1).argmin()]
        laid.append(Laid(key=f"patch[{len(laid) + 1}]", uv=UV, point=point, along=along))
    return laid


def curved_arm(mesh, direction):
    """An arm with four boards on a mesh that is curved in two directions."""
    laid = boards_around(mesh, np.asarray(direction))
    patch = Patch(tactels_uv=UV, law=Cone(), noise=20.0)
    boards = [PlacedPatch(patch=patch, node_id=k + 1, link=0, s=0.0, a=0.0) for k in range(len(laid))]
    return mesh_arm(mesh, laid, boards)


@pytest.mark.parametrize("name", SURFACES)
def test_distances_of_tactels_on_what_is_curved_in_two_directions_are_those_of_geodesics(name):
    (points, triangles), slope = SURFACES[name]
    arm = curved_arm(Mesh(points, triangles), [1.0, 0.2, 0.3])
    surface, rng, n = arm.links[0].surface, np.random.default_rng(2207), 0
    around = surface.step * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    for tactel in rng.choice(arm.n_tactels, 25, replace=False):
        here = surface.position(arm.tactel_s[tactel], arm.tactel_a[tactel])[0]
        for length in (0.005, 0.01, 0.02, 0.03, 0.04):
            along = np.cross(slope(here)[0], rng.standard_normal(3))
            there = shoot(slope, here, along / np.linalg.norm(along), length)
            s, a, _ = surface.project(there[None])
            if not surface.contains(s + around[:, 0], a + around[:, 1]).all():
                continue  # beside the chart
            found = arm.distance([tactel], s, a)[0, 0] / arm.tactel_width[tactel]
            assert abs(found - length) < (0.1e-3 if length <= 0.02 else 0.01 * length), (tactel, length)
            n += 1
    assert n > 100
    assert np.ptp(arm.tactel_width) > 0.01


def test_a_part_that_is_no_disc_or_ring_is_refused():
    ball = Mesh(*sphere(0.03, 4))
    with pytest.raises(ConfigError, match=r"closed surface|scale of the chart"):
        flatten(ball, ball.points)


def test_boards_off_the_mesh_are_refused_all_at_once():
    ball = Mesh(*sphere(0.1, 4))
    along = np.array([1.0, 0.0, 0.0])
    boards = [
        Laid(key=f"patch[{k}]", uv=UV, point=np.array([0.0, 0.0, z]), along=along)
        for k, z in ((1, 0.2), (2, -0.2))
    ]
    with pytest.raises(ConfigError) as caught:
        lay(ball, boards, "ball")
    assert [fault.key for fault in caught.value.faults] == ["patch[1].xyz_mm", "patch[2].xyz_mm"]


def test_a_chart_is_kept_by_its_content(tmp_path, arms):
    shape = mend(*tube(RADIUS, 0.2, 3e-3))
    laid = [Laid(key="patch[1]", uv=UV, point=np.array([0.1, 0.0, RADIUS]), along=np.array([1.0, 0.0, 0.0]))]
    first, rows = lay(shape, laid, "tube", tmp_path)
    files = sorted(tmp_path.iterdir())
    second, same = lay(shape, laid, "tube", tmp_path)
    assert sorted(tmp_path.iterdir()) == files
    assert np.array_equal(first.nodes, second.nodes)
    assert np.array_equal(rows[0].tactels, same[0].tactels)
    for file in files:
        file.write_bytes(b"damaged")
    third, _ = lay(shape, laid, "tube", tmp_path)
    assert np.array_equal(first.nodes, third.nodes)
