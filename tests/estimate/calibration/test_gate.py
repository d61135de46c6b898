"""What presses cannot be is refused or repaired, and named; what they can be is accepted."""

import re
from dataclasses import replace

import numpy as np
import pytest

from skinbus.cli.commands.calibrate import report
from skinbus.estimate import Estimator
from skinbus.estimate.calibration.gate import judge
from skinbus.estimate.calibration.table import PressTable
from skinbus.estimate.calibration.validation import cross_validate
from skinbus.model import Arm
from skinbus.model.patch import grid
from tests.estimate.calibration.corruptions import (
    CORRUPTIONS,
    MIRRORED,
    PressedBoards,
    boards_exchanged,
    in_unit,
    moved,
    outcome,
    swapped,
)
from tests.estimate.surrogate import Surrogate
from tests.skins import shipped_law

SEED = 20261123
pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_no_corruption_is_accepted_with_an_error(name):
    n_boards = 2 if name == "boards exchanged" else 1
    _, words = outcome([SEED, 1, list(CORRUPTIONS).index(name)], CORRUPTIONS[name], n_boards)
    assert not words.startswith("WRONG"), words


@pytest.mark.parametrize("k", range(3))
def test_good_presses_are_accepted_and_the_error_to_expect_is_the_true_one(k):
    boards = PressedBoards.draw(np.random.default_rng([SEED, 3, k]))
    judgement = judge(boards.table)
    assert not judgement.faults, judgement.faults
    assert len(judgement.outliers) <= 0.05 * len(judgement.table)
    # 40 new touches of other forces: quantiles of so few differ by half
    error = boards.error(judgement.calibration.apply(boards.arm))
    assert error < 1.5 * judgement.place_error < 1.5e-3


@pytest.fixture(scope="module")
def boards():
    return PressedBoards.draw(np.random.default_rng([SEED, 4]))


def said(table):
    return " ".join(judge(table).faults)


def test_axes_units_and_boards_that_fit_are_named(boards):
    table, rng = boards.table, np.random.default_rng(SEED)
    for corrupt, words in (
        (swapped, "with s and a swapped they do"),
        (in_unit(1e-3, 1e-3), "with places in m, not mm they do"),
        (in_unit(1.0 / 25.4, 1.0 / 25.4), "with places in inches, not mm they do"),
        (moved(MIRRORED), "mirrored"),
        (boards_exchanged, "do not go with the readings"),
    ):
        assert words in said(corrupt(table, rng))


@pytest.mark.parametrize(
    ("factor", "by", "unit", "other"),
    [(1e3, 1.0, "mN", "kN"), (1e-3, 1.0, "kN", "mN"), (1.0, 1e-3, "mN, or readings in kPa", "kN")],
)
def test_forces_or_readings_in_another_unit_are_refused_with_that_unit(boards, factor, by, unit, other):
    force, pressures = np.full(len(boards.table), 8.0 * factor), by * boards.table.pressures
    words = said(replace(boards.table, force=force, pressures=pressures))
    assert f"force_n in {unit}" in words
    assert f"force_n in {other}" not in words


def test_the_error_to_expect_is_that_of_the_law_with_its_map():
    """An array whose residuals a map halves: without it places would be wrong by 1.2 mm, not 0.15 mm."""
    surrogate = Surrogate(np.random.default_rng(1))
    presses = surrogate.presses(300, 2)
    judgement = judge(
        PressTable(
            arm=surrogate.arm,
            patch=np.zeros(300, np.intp),
            s=presses.s,
            a=presses.a,
            force=None,
            pressures=presses.readings,
        )
    )
    assert not judgement.faults
    assert judgement.calibration.residual_map is not None
    s, a = surrogate.places(300)
    estimator, off = Estimator(judgement.calibration.apply(surrogate.arm), "fit"), []
    for k, row in enumerate(surrogate.read(s, a) * judgement.calibration.gain):
        found = estimator.update(row, k)
        off.append(np.hypot(found.s[0] - s[k], found.a[0] - a[k]))
    true = np.quantile(off, 0.68)
    assert 0.7 * true < judgement.place_error < 1.4 * true


def test_readings_whose_zeros_were_not_taken_off_are_refused_with_how_large_they_are(boards):
    table, rng = boards.table, np.random.default_rng([SEED, 8])
    zero = rng.uniform(3e3, 6e3, table.arm.n_tactels)
    words = said(replace(table, pressures=table.pressures + zero))
    assert re.search(r"tactels of node 5 read 4\.\d kPa where no press is near", words), words
    assert "force_n 0" in words


def test_rows_that_do_not_go_with_the_others_are_left_out_and_listed(boards):
    table = boards.table
    s, wrong = table.s.copy(), [7, 30, 41]
    s[wrong] += np.where(table.uv()[wrong, 0] > 0.0, -0.012, 0.012)
    judgement = judge(replace(table, s=s))
    assert not judgement.faults, judgement.faults
    assert set(wrong) <= set(judgement.outliers.tolist())
    (words,) = (line for line in report(judgement, np.arange(2, 62)) if line.startswith("left out"))
    assert all(re.search(rf"\b{row + 2}\b", words) for row in wrong)


def test_too_few_and_badly_spread_presses_are_refused_with_what_is_missing(boards):
    table = boards.table
    assert "too few" in said(table.only(np.arange(12)))
    assert "gains there are not known" in said(table.only(table.uv()[:, 0] < 0.0))


def test_error_to_expect_of_presses_on_a_grid_is_that_where_it_has_none():
    """Those on tactels read a tenth too much: only calibrations from the others can show it."""
    rng, law = np.random.default_rng([SEED, 6]), shipped_law()
    arm = Arm.single_patch(grid(5, 5, 0.009), law=law, noise=200.0)
    steps = -0.021 + 0.006 * np.arange(8)
    s, a = (
        x.ravel() + arm.patches[0].s * along
        for along, x in zip((1, 0), np.meshgrid(steps, steps), strict=True)
    )
    d = arm.distance(slice(None), s, a)
    on = d.min(axis=1) < 1e-4
    pressures = law.pressure(d, 5.0) * np.where(on, 1.1, 1.0)[:, None]
    pressures += 200.0 * rng.standard_normal(d.shape)
    none, force = np.zeros(64, np.intp), np.full(64, 5.0)
    errors = cross_validate(PressTable(arm=arm, patch=none, s=s, a=a, force=force, pressures=pressures))
    assert (errors.found & on).sum() >= 4
    assert np.abs(np.median(errors.force[errors.found & on]) / 5.0 - 1.1) < 0.03
