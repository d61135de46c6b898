"""The arm as the kernels see it."""

import numpy as np

from skinbus.estimate.kernels.layout import compile_layout
from skinbus.model import Arm, grid


def test_the_neighbourhood_of_a_grid_is_the_eight_tactels_around():
    lay = compile_layout(Arm.single_patch(grid(5, 4, 0.010)))
    degree = np.diff(lay.edge_start)
    assert degree.reshape(4, 5)[1:3, 1:4].tolist() == [[8, 8, 8], [8, 8, 8]]
    assert degree[0] == 3
