"""A file of positions of an iCub becomes an arm whose tactels are where the file says."""

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from skinbus.cli import group
from skinbus.config.system import load_arm, ods_of
from skinbus.errors import ConfigError
from skinbus.gateway.frame_format import load_format
from skinbus.gateway.gateway import Gateway
from skinbus.gateway.icub import TACTELS, read_positions
from skinbus.model import Surface
from tests.files import put
from tests.robot.meshes import tube

PITCH = 6.5e-3
TRIANGLE = PITCH * np.array(
    [(k - 0.5 * (n - 1), 0.87 * (row - 1.2)) for row, n in enumerate((4, 3, 2, 1)) for k in range(n)]
)
"""Ten tactels; its neighbour, turned by half a turn, fits beside it."""
X_LS = Rotation.from_euler("xyz", [20.0, -30.0, 50.0], degrees=True)
ORIGIN = np.array([0.01, -0.02, 0.05])
N_TRIANGLES, CUT, LEFT_OUT = 18, 4, 7
"""Triangle 4 has lost three tactels, 7 is not there."""


def table(surface):
    """Return rows of three boards with triangles side by side on a surface in an oblique frame."""
    rows = np.zeros((3 * 192, 6))
    for t in range(N_TRIANGLES):
        if t == LEFT_OUT:
            continue
        i, j = divmod(t, 6)
        turn = 1.0 if (i + j) % 2 else -1.0
        s = 0.03 + 0.016 * j + turn * TRIANGLE[:, 0]
        a = 0.03 * (i - 1) + turn * TRIANGLE[:, 1]
        points, normals = surface.position(s, a)
        own = 12 * t + np.array(TACTELS)
        rows[own] = np.column_stack([X_LS.apply(points) + ORIGIN, 0.9 * X_LS.apply(normals)])
        if t == CUT:
            rows[own[-3:]] = 0.0
    return rows


def text(rows, of=None):
    of = np.where(rows.any(axis=1), np.arange(len(rows)), -1) if of is None else of
    lines = "\n".join(" ".join(f"{x:.5f}" for x in row) for row in rows)
    head = f"name l_upper_arm\nspatial_sampling taxel\ntaxel2Repr ({' '.join(map(str, of))})"
    return f"{head}\n[calibration]\n{lines}\n"


def imported(folder, content, *args):
    return CliRunner().invoke(
        group,
        ["board", "import", str(put(folder, "positions.txt", content)), "--out", str(folder / "out"), *args],
    )


SURFACES = [Surface.cylinder(0.2, 0.045), Surface.cylinder(0.2, 0.3), Surface.plane(0.2, 0.2)]


@pytest.mark.parametrize("surface", SURFACES, ids=["arm", "leg", "torso"])
def test_tactels_are_where_the_file_says_on_the_surface_that_fits(tmp_path, surface):
    rows = table(surface)
    answer = imported(tmp_path, text(rows), "--first-board", "3")
    assert answer.exit_code == 0, answer.output + str(answer.exception)
    assert f"nearest {surface.kind}" in answer.output
    assert "0.0 mm off it (RMS)" in answer.output
    file = tmp_path / "out" / "l_upper_arm.toml"
    arm = load_arm(file, check_load=False)
    assert arm.links[0].surface.kind == surface.kind
    assert arm.links[0].surface.radius == pytest.approx(surface.radius, rel=1e-3)
    lines = dict(line.lstrip("# ").split(" = ") for line in file.read_text().splitlines() if " = " in line)
    xyz, rpy = (np.array(lines[key].strip("[]").split(", "), float) for key in ("xyz_mm", "rpy_deg"))
    points, normals = arm.links[0].surface.position(arm.tactel_s, arm.tactel_a)
    turn = Rotation.from_euler("xyz", rpy, degrees=True)
    healthy = arm.tactel_healthy
    there = rows[rows.any(axis=1)]
    assert_allclose(turn.apply(points[healthy]) + 1e-3 * xyz, there[:, :3], atol=1e-4)
    assert_allclose(turn.apply(normals[healthy]), there[:, 3:] / 0.9, atol=5e-3)


def test_each_triangle_with_tactels_is_a_patch_with_its_address(tmp_path):
    imported(tmp_path, text(table(SURFACES[0])), "--first-board", "3")
    arm = load_arm(tmp_path / "out" / "l_upper_arm.toml", check_load=False)
    numbers = [divmod(t, 16) for t in range(N_TRIANGLES) if t != LEFT_OUT]
    assert [patch.address for patch in arm.patches] == [f"{3 + board}.{t}" for board, t in numbers]
    assert {patch.patch.n_tactels for patch in arm.patches} == {len(TACTELS)}
    Gateway(load_format("icub-mtb4"), arm, ods_of(arm))  # takes it as it is
    (cut,) = [patch.patch for patch in arm.patches if not patch.patch.healthy.all()]
    assert cut.healthy.tolist() == [True] * 7 + [False] * 3
    assert cut.transducer.bits == 16
    assert cut.transducer.converter_bits == 8


@pytest.mark.parametrize("row", [0, 12 * CUT])
def test_rows_that_repeat_another_one_are_no_tactels(tmp_path, row):
    rows = table(SURFACES[0])
    of = np.arange(len(rows))
    of[row] = row + 1
    healthy = read_positions(put(tmp_path, "p.txt", text(rows, of))).healthy
    assert not healthy[row // 12, 0]
    assert healthy.sum() == rows.any(axis=1).sum() - 1


def test_boards_are_laid_on_a_mesh(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("potpourri3d")
    points, triangles = tube(0.045, 0.2, 4e-3)
    vertices = 1e3 * (X_LS.apply(points) + ORIGIN)
    trimesh.Trimesh(vertices, triangles, process=False).export(tmp_path / "arm.stl")
    rows = table(SURFACES[0])
    answer = imported(tmp_path, text(rows), "--mesh", str(tmp_path / "arm.stl"))
    assert answer.exit_code == 0, answer.output + str(answer.exception)
    arm = load_arm(tmp_path / "out" / "l_upper_arm.toml", check_load=False)
    points, _ = arm.links[0].surface.position(arm.tactel_s, arm.tactel_a)
    there = rows[rows.any(axis=1), :3]
    assert_allclose(points[arm.tactel_healthy], there, atol=3e-4)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t.replace("0.00000 0.00000 0.00000", "0.0 0.0", 1), "line 11"),
        (lambda t: t.replace("[calibration]\n", "[calibration]\n0 0 x 0 0 0\n"), "line 5"),
        (lambda t: t.replace("[calibration]\n", "[calibration]\n0 0 nan 0 0 0\n"), "x y z nx ny nz"),
        (lambda t: t + "0 0 0 0 0 0\n", "12 for each triangle"),
        (lambda t: t.replace("taxel2Repr (", "taxel2Repr (5 "), "577 numbers"),
        (lambda t: t.replace("taxel2Repr (0", "taxel2Repr (0-"), "575 numbers"),
        (lambda t: text(np.vstack([np.ones((1, 6)), np.zeros((11, 6))])), "pitch of inf"),
        (lambda t: "", "rows"),
        (lambda t: text(np.zeros((192, 6))), "no tactel"),
    ],
)
def test_a_file_with_faults_is_refused_and_nothing_is_written(tmp_path, change, said):
    answer = imported(tmp_path, change(text(table(SURFACES[0]))))
    assert isinstance(answer.exception, ConfigError)
    assert said in str(answer.exception)
    assert not (tmp_path / "out").exists()
