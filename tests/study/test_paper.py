"""The trends that the paper states, on small fixed samples."""

import pytest

from skinbus.study.paper import EDGE, PaperCase, press
from tests.marks import levels

TRIALS = 60
SEED = 20


def errors(**case):
    """Errors by level of one cell."""
    return {e.level: e for e in press(PaperCase(**case), trials=TRIALS, seed=SEED)}


@pytest.fixture(scope="module")
def density():
    return [errors(side=side, pitch=EDGE / side) for side in (3, 4, 5, 8)]


@levels
@pytest.mark.parametrize("column", ["position_mm", "force_pct"])
def test_denser_tactels_err_less_in_place_and_force_as_figures_7_and_8(density, level, column):
    values = [getattr(cell[level], column) for cell in density]
    assert values == sorted(values, reverse=True), values


@pytest.mark.parametrize("n_touches", [1, 2])
@pytest.mark.parametrize("column", ["position_mm", "force_pct"])
def test_larger_forces_err_less_as_figures_9_and_10(n_touches, column):
    values = [getattr(errors(force=f, n_touches=n_touches)["kmeans"], column) for f in (1.0, 3.0, 8.0)]
    assert values == sorted(values, reverse=True), values


@pytest.mark.parametrize("column", ["position_mm", "force_pct"])
def test_faster_drop_off_errs_more_as_figures_11_and_12(column):
    values = [getattr(errors(slope=slope)["kmeans"], column) for slope in (5e6, 10e6, 20e6)]
    assert values == sorted(values), values


def test_slow_drop_off_saturates_the_layer_as_figure_13():
    """With a slow drop-off more force is worse, with a fast one better."""
    slow = [errors(slope=0.6e6, force=f)["kmeans"].position_mm for f in (3.0, 8.0, 25.0)]
    fast = [errors(slope=10e6, force=f)["kmeans"].position_mm for f in (3.0, 8.0, 25.0)]
    assert slow == sorted(slow), slow
    assert fast[0] > 2.0 * fast[2], fast
    assert slow[2] > 2.0 * fast[2]


def test_fit_is_not_saturated_where_the_centroid_is():
    cell = errors(slope=0.6e6, force=25.0)
    assert cell["fit"].position_mm < 0.2 * cell["kmeans"].position_mm
