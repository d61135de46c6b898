"""Boards are found where they sit, with the covariance that their errors have; what is not known is said."""

import math
from dataclasses import replace

import numpy as np
import pytest

from skinbus.estimate.calibration.location import PRIOR_SD, locate
from skinbus.model import Arm
from tests.estimate.calibration.located_boards import errors, made, misplaced, pressed

SEED = 20261201


def rms(column):
    return math.sqrt(np.mean(np.square(column)))


@pytest.mark.slow
@pytest.mark.parametrize("surface", ["cone", "plane", "cylinder"])
def test_twenty_boards_off_by_3_mm_and_3_deg_are_found_by_six_presses_each(tmp_path, surface):
    planned, true, presses = made(tmp_path, surface, SEED)
    found = locate(planned, presses)
    left = errors(true, found)
    assert rms(np.hypot(*left[:, :2].T)) < 0.3e-3
    # what is known of the places: the least that any method errs, at these presses
    floor = [least_yaw(planned, presses, board.patch) for board in found.boards]
    assert rms(left[:, 2]) < 1.35 * rms(
        floor
    )  # 20 boards: 95 % of samples are below 1.26 of their expectation
    assert_covariances_are_true(left, found)
    assert not any(board.outliers or board.unusable or board.unknown for board in found.boards)


def assert_covariances_are_true(left, found):
    nees = np.mean(
        [r @ np.linalg.solve(b.covariance, r) / 3 for r, b in zip(left, found.boards, strict=True)]
    )
    assert 0.5 < nees < 2.0


def least_yaw(arm, presses, p):
    """Standard deviation of the yaw of a board, if contacts were exact: Cramer-Rao."""
    placed = arm.patches[p]
    own = [press for press in presses if press.patch == p]
    surface = arm.links[placed.link].surface
    xy = np.stack(surface.develop([q.s for q in own], [q.a for q in own], placed.a), -1)
    return 0.3e-3 / math.sqrt(np.square(xy - xy.mean(axis=0)).sum())


@pytest.mark.slow
def test_outliers_are_found_by_number_and_do_no_harm(tmp_path):
    planned, true, presses = made(tmp_path, "cylinder", SEED + 1, n=8)
    bad = [3, 17, 18, 60, 141]
    for k in bad:
        presses[k] = presses[k]._replace(s=presses[k].s + 8e-3, a=presses[k].a - 5e-3)
    found = locate(planned, presses)
    assert sorted(k for board in found.boards for k in board.outliers) == bad
    assert rms(np.hypot(*errors(true, found)[:, :2].T)) < 0.3e-3


@pytest.mark.slow
def test_places_worse_than_said_widen_the_covariance(tmp_path):
    planned, true, presses = made(tmp_path, "plane", SEED + 2, sd=1.0e-3)
    found = locate(planned, presses, place_sd=0.3e-3)
    assert 0.8e-3 < found.place_sd < 1.2e-3
    left = errors(true, found)
    assert_covariances_are_true(left, found)


def small(tmp_path, **settings):
    """One board off by a known amount, and presses."""
    planned, _, _ = made(tmp_path, "cone", SEED, n=1)
    planned = Arm(planned.name, planned.links, planned.patches[:1], *planned.buses)
    true = misplaced(planned, np.random.default_rng(SEED + 4))
    return planned, true, pressed(true, SEED + 5, **settings)


def test_what_presses_do_not_determine_stays_and_is_named(tmp_path):
    planned, true, presses = small(tmp_path, n=6, half=0.5e-3)
    (board,) = locate(planned, presses).boards
    assert board.unknown == ("yaw",)
    assert abs(board.shift[2]) < math.radians(3.0)
    assert rms(errors(true, locate(planned, presses))[:, :2]) < 0.5e-3
    (board,) = locate(planned, small(tmp_path, n=1)[2]).boards
    assert "yaw" in board.unknown
    assert np.sqrt(board.covariance[2, 2]) == pytest.approx(PRIOR_SD[2], rel=0.1)


def test_a_press_without_a_contact_or_with_two_is_not_used(tmp_path):
    planned, _, presses = small(tmp_path, n=6)
    presses[1] = presses[1]._replace(readings=np.zeros(16))
    presses[4] = presses[4]._replace(readings=presses[2].readings + presses[5].readings)
    (board,) = locate(planned, presses).boards
    assert board.unusable == (1, 4)
    (none,) = locate(planned, [press._replace(readings=np.zeros(16)) for press in presses]).boards
    assert none.used == ()


@pytest.mark.parametrize("what", ["turned", "mirrored"])
def test_a_board_that_is_turned_or_mirrored_is_named(tmp_path, what):
    planned, _, _ = small(tmp_path)
    (placed,) = planned.patches
    if what == "turned":
        other = replace(placed, yaw=placed.yaw + 0.5 * math.pi)
    else:
        other = replace(placed, patch=placed.patch.mirrored())
    presses = pressed(Arm("x", planned.links, [other], *planned.buses), SEED + 6, n=8)
    (board,) = locate(planned, presses).boards
    assert (board.is_turned, board.is_mirrored) == (what == "turned", what == "mirrored")


def test_swapped_axes_and_wrong_units_fit_no_place(tmp_path):
    planned, _, presses = small(tmp_path, n=12)
    for wrong in (
        [q._replace(s=q.a, a=q.s) for q in presses],
        [q._replace(s=1e-3 * q.s, a=1e-3 * q.a) for q in presses],
    ):
        (board,) = locate(planned, wrong).boards
        assert board.is_mirrored or board.is_turned or len(board.outliers) > len(board.used)
