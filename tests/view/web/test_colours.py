"""Pressure is a colour of one map, and the colour that a browser shows is that of the legend."""

import numpy as np
import pytest

from skinbus.view.web.colours import for_instances, shades


def aces(linear):
    """What three.js makes of light, written from its shader: sRGB (n, 3) of 0..255."""
    x = linear / 0.6
    x = x @ np.array([[0.59719, 0.35458, 0.04823], [0.076, 0.90834, 0.01566], [0.0284, 0.13383, 0.83777]]).T
    x = (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.432951) + 0.238081)
    x = (
        x
        @ np.array(
            [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
        ).T
    )
    x = np.clip(x, 0.0, 1.0)
    return 255.0 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1.0 / 2.4) - 0.055)


def test_browser_shows_the_colour_of_the_legend():
    """Yellow is more saturated than what the renderer can show: there its blue is off."""
    wanted = shades(np.linspace(0.0, 30e3, 50), full_pa=30e3).astype(float)
    for light in (1.2, 1.4):
        off = np.abs(aces(for_instances(wanted, light) / 255.0 * light) - wanted)
        assert off[:40].max() < 10
        assert off[40:, :2].max() < 20
        assert off[40:, 2].max() < 90


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
