"""Corrections of distances on a chart: kernels and tables agree, derivatives are those of the value."""

import numpy as np
import pytest

from skinbus.model.bend import COLUMNS, MOST, POWERS, bent
from skinbus.model.bend_kernel import bend_at


def test_kernels_and_tables_agree_and_derivatives_are_those_of_the_value():
    rng = np.random.default_rng(92)
    bends = rng.normal(0.0, 2.0 * 3.0**POWERS, (300, COLUMNS))
    places = rng.uniform(-0.2, 0.2, (300, 2))
    h, n_within = 1e-6, 0
    for i, (x, y) in enumerate(places):
        value, by_x, by_y = bend_at.py_func(bends, i, x, y)
        assert value == pytest.approx(float(bent(bends[i], x, y)))
        assert 1.0 / MOST <= value <= MOST
        n_within += 1.0 / MOST < value < MOST
        steps = [
            (bend_at.py_func(bends, i, x + dx, y + dy)[0] - bend_at.py_func(bends, i, x - dx, y - dy)[0])
            for dx, dy in ((h, 0.0), (0.0, h))
        ]
        assert (by_x, by_y) == pytest.approx([step / (2.0 * h) for step in steps], abs=1e-3)
    assert n_within > 100
