"""What presses cannot be is refused or repaired, and named; what they can be is accepted."""

import re
from dataclasses import replace

import numpy as np
import pytest

from skinbus.cli.commands.calibrate import verdict
from skinbus.estimate import Estimator
from skinbus.estimate.calibration import Judgement, judge, learn_radial_law
from skinbus.estimate.calibration.gate import spread_faults
from skinbus.estimate.calibration.table import PressTable
from skinbus.estimate.calibration.validation import HeldOutErrors, cross_validate
from skinbus.model import Arm
from skinbus.model.patch import grid
from tests.estimate.calibration.corruptions import (
    CORRUPTIONS,
    PressedBoards,
    boards_exchanged,
    swapped,
    turned,
)
from tests.estimate.calibration.trial import outcome
from tests.estimate.surrogate import Surrogate
from tests.skins import shipped_law

SEED = 20261123


@pytest.mark.parametrize(
    "corrupt",
    [
        pytest.param(
            f, id=f.__name__, marks=[pytest.mark.slow] * (f not in (swapped, turned, boards_exchanged))
        )
        for f in CORRUPTIONS
    ],
)
def test_no_corruption_is_accepted_with_an_error(corrupt):
    found = outcome([SEED, 1], corrupt, small=True)
    print(found.verdict, [finding.what for finding in found.judgement.faults], found.error)
    assert found.verdict != "WRONG"


@pytest.mark.slow
@pytest.mark.parametrize("k", range(len(CORRUPTIONS)))
def test_no_corruption_of_large_boards_is_accepted_with_an_error(k):
    assert outcome([SEED, 2, k], CORRUPTIONS[k]).verdict != "WRONG"


@pytest.mark.slow
@pytest.mark.parametrize("k", range(3))
def test_good_presses_are_accepted_and_the_error_to_expect_is_the_true_one(k):
    judgement, error = outcome([SEED, 3, k], small=True)
    assert not judgement.faults, judgement.faults
    assert len(judgement.outliers) <= 0.05 * len(judgement.table)
    # 40 new touches of other forces: quantiles of so few differ by half
    assert error < 1.5 * judgement.place_error < 1.5e-3


@pytest.fixture(scope="module")
def boards():
    return PressedBoards.draw(np.random.default_rng([SEED, 4]), small=True)


def said(table):
    judgement = judge(table)
    return " ".join(finding.what for finding in judgement.faults)


@pytest.mark.slow
def test_axes_units_and_boards_that_fit_are_named(boards):
    table, rng = boards.table, np.random.default_rng(SEED)
    assert "with s and a swapped they do" in said(swapped(table, rng))
    assert "with places in m, not mm they do" in said(replace(table, s=1e-3 * table.s, a=1e-3 * table.a))
    assert "with a in inches, not mm they do" in said(replace(table, a=table.a / 25.4))
    words = said(turned(table, rng))
    assert "turned" in words or "mirrored" in words or "swapped" in words
    assert "do not go with the readings" in said(boards_exchanged(table, rng))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "unit", "other"), [(1e3, "mN", "kN"), pytest.param(1e-3, "kN", "mN", marks=pytest.mark.slow)]
)
def test_forces_in_another_unit_are_refused_with_that_unit(boards, factor, unit, other):
    words = said(replace(boards.table, force=np.full(len(boards.table), 8.0 * factor)))
    assert f"force_n in {unit}" in words
    assert f"force_n in {other}" not in words


@pytest.mark.slow
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
    print(true, judgement.place_error)
    assert 0.7 * true < judgement.place_error < 1.4 * true


@pytest.mark.slow
def test_readings_whose_zeros_were_not_taken_off_are_refused_with_how_large_they_are(boards):
    table, rng = boards.table, np.random.default_rng([SEED, 8])
    zero = rng.uniform(3e3, 6e3, table.arm.n_tactels)
    words = said(replace(table, pressures=table.pressures + zero))
    assert re.search(r"tactels of node 5 read 4\.\d kPa where no press is near", words), words
    assert "force_n 0" in words


@pytest.mark.slow
def test_rows_that_do_not_go_with_the_others_are_left_out_and_listed(boards):
    table = boards.table
    s, wrong = table.s.copy(), [7, 30, 41]
    s[wrong] += np.where(table.uv()[wrong, 0] > 0.0, -0.012, 0.012)
    judgement = judge(replace(table, s=s))
    assert not judgement.faults, judgement.faults
    assert set(wrong) <= set(judgement.outliers.tolist())
    assert set(wrong) <= {row for finding in judgement.notes for row in finding.rows}


def test_too_few_and_badly_spread_presses_are_refused_with_what_is_missing(boards):
    table = boards.table
    assert "too few" in said(table.only(np.arange(12)))
    assert "gains there are not known" in said(table.only(table.uv()[:, 0] < 0.0))


def on_a_grid(uneven=0.0):
    """64 presses on a grid of two thirds of the pitch; those on a tactel read a tenth too much."""
    rng, law = np.random.default_rng([SEED, 6]), shipped_law()
    arm = Arm.single_patch(grid(5, 5, 0.009), law=law, noise=200.0)
    placed, steps = arm.patches[0], -0.021 + 0.006 * np.arange(8)
    u, v = (x.ravel() + uneven * rng.uniform(-0.5, 0.5, 64) for x in np.meshgrid(steps, steps))
    s, a = placed.s + u, placed.a + v
    d = arm.distance(slice(None), s, a)
    pressures = law.pressure(d, 5.0) * np.where(d.min(axis=1) < 1e-4, 1.1, 1.0)[:, None]
    return PressTable(
        arm=arm,
        patch=np.zeros(64, np.intp),
        s=s,
        a=a,
        force=np.full(64, 5.0),
        pressures=pressures + 200.0 * rng.standard_normal(d.shape),
    )


def test_distances_that_a_grid_leaves_out_are_named_and_such_a_calibration_is_not_good():
    missing, said = spread_faults(on_a_grid())
    assert not missing
    (words,) = said
    assert "at distances of 0.0 to 3.0 mm" in words
    assert "press at uneven places" in words
    assert spread_faults(on_a_grid(uneven=0.006)) == ([], [])


@pytest.mark.slow
def test_error_to_expect_of_presses_on_a_grid_is_that_where_it_has_none():
    """Those on tactels read too much: only calibrations from the others can show it."""
    table = on_a_grid()
    errors = cross_validate(table)
    d = table.arm.distance(slice(None), table.s, table.a)
    on = errors.found & (d.min(axis=1) < 1e-4)
    assert on.sum() >= 4
    assert np.abs(np.median(errors.force[on]) / 5.0 - 1.1) < 0.03


def test_only_a_calibration_that_converged_from_presses_at_all_distances_is_good():
    table, errors = (
        on_a_grid(uneven=0.006),
        HeldOutErrors(
            inside=np.ones(64, np.bool_),
            uv=np.zeros((64, 2)),
            sd=np.full(64, 1e-4),
            force=np.full(64, 5.0),
        ),
    )
    learned = learn_radial_law(table.arm, table.s, table.a, table.force, table.pressures, maps=False)
    judgement = Judgement(
        table=table,
        calibration=learned,
        faults=(),
        outliers=np.zeros(0, np.intp),
        errors=errors,
        shipped=errors,
    )
    assert judgement.is_good
    for part in (
        replace(judgement, calibration=replace(learned, converged=False)),
        replace(judgement, table=on_a_grid()),
        replace(judgement, errors=replace(errors, force=np.full(64, 5.5))),  # stated forces are 5 N
    ):
        assert not part.is_good
        assert "this is fair" in verdict(part, np.arange(64))
