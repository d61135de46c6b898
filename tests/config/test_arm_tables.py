"""Boards are where the page of the arm file says."""

from pathlib import Path

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.model.patch import grid

PAGE = (Path(__file__).parents[2] / "docs" / "arm-file.md").read_text()


def places():
    section = PAGE.partition("Where the middle of a board is")[2].partition("\nA board has")[0]
    lines = [line for line in section.splitlines() if line.startswith("| `")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


@pytest.mark.parametrize("row", places())
def test_boards_are_where_the_page_says(row, tmp_path):
    link, board = (cell.replace("`", "").replace(", ", "\n") for cell in row[:2])
    text = f'[arm]\nname = "x"\n[[link]]\nname = "l"\n{link}\n[[patch]]\nlink = "l"\nnode_id = 1\n{board}\n'
    file = tmp_path / "arm.toml"
    file.write_text(text)
    arm = load_arm(file)
    (placed,) = arm.patches
    surface = arm.links[0].surface
    point, normal = surface.position(placed.s, placed.a)
    np.testing.assert_allclose(1e3 * point, np.array(row[2].split(","), float), atol=1e-3)
    np.testing.assert_allclose(normal, np.array(row[3].split(","), float), atol=1e-3)
    step = 1e-6
    along = surface.position(placed.s + step, placed.a)[0] - point
    around = surface.position(placed.s, placed.a + step)[0] - point
    np.testing.assert_allclose(np.cross(along, around) / step**2, normal, atol=1e-3)


@pytest.mark.parametrize(
    ("yaw", "mirrored", "u", "v"),
    [(0, False, (1, 0), (0, 1)), (90, False, (0, 1), (-1, 0)), (0, True, (1, 0), (0, -1))],
)
def test_axes_of_a_board_run_as_the_page_says(yaw, mirrored, u, v, tmp_path):
    file = tmp_path / "arm.toml"
    is_mirrored = str(mirrored).lower()
    file.write_text(
        '[arm]\nname = "x"\n[[link]]\nname = "l"\nsurface = "plane"\nlength_mm = 80\nwidth_mm = 80\n'
        f'[[patch]]\nlink = "l"\nnode_id = 1\ns_mm = 40\nyaw_deg = {yaw}\nmirrored = {is_mirrored}\n'
    )
    arm = load_arm(file)
    places = np.stack([arm.tactel_s - 0.04, arm.tactel_a], -1)
    drawn = grid(4, 4, 0.010)
    np.testing.assert_allclose(places, drawn @ np.array([u, v], float), atol=1e-9)


def test_columns_of_a_grid_run_along_u():
    assert np.ptp(grid(6, 2, 0.008), axis=0).tolist() == pytest.approx([0.040, 0.008])
