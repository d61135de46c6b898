"""The modes by size are those of discs on the usual layer, for tactels of any size."""

import numpy as np
import pytest

from skinbus.estimate.kernels.disc_shapes import (
    FINGERTIP,
    MODES,
    SMALL,
    SMALL_MODES,
    SPACING,
    USUAL,
    USUAL_MODES,
    disc_shapes,
)
from skinbus.sim.bonded_layer import profile
from skinbus.study.skin_models import shipped_law

LAYER = {"thickness": 0.006, "poisson": 0.48}
D = 0.25e-3 * np.arange(161)


def disc(size_mm, radius):
    return profile(D, indenter_radius=0.5e-3 * size_mm, tactel_radius=radius, **LAYER)


@pytest.mark.parametrize(
    ("modes", "radius", "square"), [(SMALL_MODES, 2.5e-3, SMALL), (USUAL_MODES, 4.765e-3, USUAL)]
)
def test_tables_are_least_squares_over_discs(modes, radius, square):
    sizes = np.arange(1.0, 26.5)
    fields = np.stack([disc(size, radius) for size in sizes])
    finger = disc(1e3 * FINGERTIP, radius)
    half = np.interp(-0.5, -finger / finger[0], D)
    assert (radius / half) ** 2 == pytest.approx(square, rel=1e-3)
    u = np.log(0.5 + 0.5 * (1e-3 * sizes / FINGERTIP) ** 2)
    weight = 1.0 / fields[:, :1]
    powers = u[:, None] ** np.arange(1, MODES + 1)
    found = np.linalg.lstsq(powers * weight, (fields - finger) * weight, rcond=None)[0] / finger[0]
    at = SPACING * half * np.arange(modes.shape[1])
    tables = np.stack([np.interp(at, D, mode) for mode in found])
    assert np.abs(tables - tables[:, -1:] - modes).max() < 1e-3


@pytest.mark.parametrize("radius_mm", [2.0, 3.5, 4.765])
@pytest.mark.parametrize("size_mm", [2.0, 5.0, 9.0, 14.0, 19.0, 25.0])
def test_discs_of_any_size_are_met_to_some_per_cent_of_their_peak(size_mm, radius_mm):
    radius = 1e-3 * radius_mm
    law = np.mean([disc(size, radius) for size in (10.0, 12.0, 15.0)], axis=0)
    modes, wanted = disc_shapes(D[1], law, radius), disc(size_mm, radius)
    u = np.linspace(-0.9, 1.3, 221)
    fields = law + (u[:, None] ** np.arange(1, MODES + 1)) @ modes
    assert np.abs(fields - wanted).max(axis=1).min() < 0.04 * wanted[0]


def test_the_law_that_ships_meets_a_tip_and_a_thumb():
    law = shipped_law()
    d = law.step * np.arange(len(law.table))
    modes = disc_shapes(law.step, np.asarray(law.table), 4.765e-3)
    for size_mm, u in ((2.0, -0.67), (25.0, 0.95)):
        wanted = profile(d, indenter_radius=0.5e-3 * size_mm, tactel_radius=4.765e-3, **LAYER)
        field = np.asarray(law.table) + (u ** np.arange(1, MODES + 1)) @ modes
        assert np.abs(field - wanted).max() < 0.05 * wanted[0]


@pytest.mark.parametrize("table", [np.ones(1), np.ones(5), np.zeros(4), np.array([1.0, 0.0])])
def test_laws_without_a_width_have_finite_modes(table):
    assert np.isfinite(disc_shapes(1e-3, table, 5e-3)).all()
