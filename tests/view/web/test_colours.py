"""Pressure is a colour of one map; that a browser shows it is in ``test_page.py``."""

import numpy as np
import pytest

from skinbus.view.web.colours import shades


def test_shades_are_those_of_viridis():
    matplotlib = pytest.importorskip("matplotlib")
    wanted = 255.0 * matplotlib.colormaps["viridis"](np.linspace(0.0, 1.0, 101))[:, :3]
    assert (
        np.abs(shades(np.linspace(0.0, 30e3, 101), full_pa=30e3) - wanted).max() < 5.0
    )  # that has 256 steps


def test_pressures_beyond_the_map_have_its_ends():
    low, high = shades(np.array([0.0, 30e3]), full_pa=30e3)
    assert (shades(np.array([-5e3, np.nan]), full_pa=30e3) == low).all()
    assert (shades(np.array([1e6, np.inf]), full_pa=30e3) == high).all()
