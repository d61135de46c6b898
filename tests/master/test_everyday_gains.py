"""Relative gains are learned from touches that nobody labels, and no kind of touches spoils them."""

import json

import numpy as np
import pytest

from skinbus.master.everyday_gains import BOUND, FEWEST, EverydayGains
from tests.master.everyday_touches import Touched

SEED = 20261207


@pytest.mark.parametrize("k", [1, 2])
def test_three_hundred_touches_bring_gains_from_three_percent_to_about_one(k):
    """Of a board of 36 tactels; those of 16 leave a third of the scatter unknown, and halve the rest."""
    board = Touched([SEED, k])
    before = board.spread
    for _ in range(300):
        board.touch(board.fingers())
    print(before, board.spread, board.everyday.boards[0].watch.n_contacts)
    assert board.spread < 0.5 * before  # 1.1 % RMS of six boards, 0.8 to 1.3 %
    assert board.everyday.factor.mean() == pytest.approx(1.0, abs=1e-3)


def test_gains_of_few_tactels_are_found_nearly_as_well_as_contacts_tell_of_them():
    """Three of 16 gains are hardly known from 300 contacts: what is left on four boards varies by a fifth."""
    boards = [Touched([SEED, 5, k], 4, 0.010) for k in range(4)]
    for board in boards:
        for _ in range(300):
            board.touch(board.fingers())
    left = np.sqrt(np.mean([board.spread**2 for board in boards]))
    least = boards[0].least_spread(300)
    print(left, least)
    assert 0.01 < least < 0.015
    assert left < 1.4 * least


@pytest.mark.parametrize("kind", ["same_place", "too_strong", "broken_neighbour"])
def test_no_kind_of_touches_drives_gains_out_of_bounds_or_spoils_places(kind):
    """A hundred thousand: ``python -m tests.master.everyday_touches KIND 100000 SEED``."""
    board = Touched([SEED, 10], 4, 0.010)
    seen = [getattr(board, kind)() for _ in range(200)]
    for k in range(1500):
        board.touch(seen[k % len(seen)])
    assert (np.abs(board.everyday.factor - 1.0) <= BOUND).all()
    plain, learned = board.errors(is_broken=kind == "broken_neighbour", n=100)
    print(kind, plain, learned, board.everyday.boards[0].watch.n_contacts)
    assert learned <= 1.05 * plain


def test_contacts_with_a_flag_or_beside_another_teach_nothing():
    board = Touched([SEED, 11], 4, 0.010)
    pressures = board.read(board.feel(np.array([0.0, 0.0, 8.0])))
    own = board.everyday.boards[0]
    for flag in (1, 2, 4, 8, 16, 32, 64):
        contacts = board.contacts(pressures)
        contacts.quality[:] = flag
        board.everyday.observe(contacts, pressures)
    assert own.watch.n_contacts == own.cells.sum() == 0
    board.everyday.observe(board.contacts(pressures), pressures)
    assert own.watch.n_contacts == 1


def test_readings_at_full_scale_stay_there():
    board = Touched([SEED, 12], 4, 0.010)
    everyday = board.everyday
    everyday.factor[:] = 0.95
    pressures = np.array([250e3, 251e3, 100e3, -5e3] * 4)
    everyday.correct(pressures, np.zeros(16))
    np.testing.assert_allclose(pressures[:4], [250e3, 251e3, 95e3, -4750.0])


def test_what_was_learned_outlives_a_restart_and_nothing_else_is_taken_up():
    board = Touched([SEED, 13])
    for _ in range(200):
        board.touch(board.fingers())
    board.everyday.stamp("2026-11-22")
    own = board.everyday.boards[0]
    assert own.cells.sum() > FEWEST
    assert own.moved > 0.005
    table = json.loads(json.dumps(own.as_table()))
    again = EverydayGains(board.arm)
    again.resume(0, table)
    np.testing.assert_allclose(again.factor, board.everyday.factor, atol=1e-5)
    assert again.boards[0].date == "2026-11-22"
    for key in ("factor", "cells", "information", "score", "contacts"):
        for wrong in (None, 1, "x", [], {}, [2.0] * 36, ["x"] * 36, True):
            fresh = EverydayGains(board.arm)
            fresh.resume(0, {**table, key: wrong})
            assert (np.abs(fresh.factor - 1.0) <= BOUND).all()
    fresh.resume(0, "x")
