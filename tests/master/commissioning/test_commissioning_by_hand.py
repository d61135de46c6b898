"""Boards off by 2 mm and 3 degrees with gains that differ by 5 % become a skin that is true to 0.3 mm."""

import pytest

from tests.master.commissioning.by_hand import rms, steps

SEED = 20261210


@pytest.mark.parametrize("n", [4, pytest.param(24, marks=pytest.mark.slow)])
def test_thirty_presses_a_board_make_contacts_truer_and_on_24_boards_true_to_three_tenths_of_a_millimetre(n):
    """Four boards have a sixth of the presses to learn their law from: 0.33 mm."""
    _, errors, gains = steps(n, 30, SEED, 120)
    off = {step: rms(own) for step, (own, _) in errors.items()}
    print(off, gains)
    assert off["identified"] > 1e-3
    assert off["calibrated"] < off["located"]
    assert n < 24 or off["calibrated"] < 0.3e-3
    assert sum(n_false for _, n_false in errors.values()) == 0
    assert gains < 0.025  # 5 % before
