"""crosstalk: shares of the others in the row and in the column, and nothing from other boards."""

import numpy as np

from skinbus.sim.effects.crosstalk import Crosstalk, lines_of


def test_one_loaded_tactel_is_read_in_its_row_and_column(apply, pad):
    p = np.zeros(16)
    p[5] = 1e4  # column 1, row 1 of a 4 x 4 board numbered row by row
    out = apply(Crosstalk(row=0.02, column=0.05), p, [0.0], arm=pad)[0].reshape(4, 4)
    wanted = np.zeros((4, 4))
    wanted[1, :] = 0.02 * 1e4
    wanted[:, 1] = 0.05 * 1e4
    wanted[1, 1] = 1e4
    np.testing.assert_allclose(out, wanted, atol=1e-9)


def test_it_is_the_matrix_it_says(apply, forearm):
    rng = np.random.default_rng(5)
    print("seed 5")
    p = 1e4 * rng.random(forearm.n_tactels)
    rows, columns = lines_of(forearm)
    others = ~np.eye(forearm.n_tactels, dtype=bool)
    matrix = 0.03 * ((rows[:, None] == rows) & others) + 0.01 * ((columns[:, None] == columns) & others)
    out = apply(Crosstalk(row=0.03, column=0.01), p, [0.0])[0]
    np.testing.assert_allclose(out, p + matrix @ p, rtol=1e-12)


def test_boards_share_no_lines(forearm):
    for lines in lines_of(forearm):
        for p in range(forearm.n_patches):
            here = lines[forearm.tactels_of(p)]
            assert len(np.unique(here)) == 4
            assert set(here.tolist()).isdisjoint(lines[: forearm.patch_start[p]].tolist())
