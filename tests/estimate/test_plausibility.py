"""Plausibility: tactels that cannot be right are named in time and come back; healthy ones are left alone."""

import numpy as np
import pytest

from skinbus.estimate import TactelFault
from skinbus.sim.laws import Elastic
from tests.estimate.false_alarms import GAIN_SD, touched
from tests.estimate.judged_skin import (
    ARM,
    BOARD,
    CORNER,
    EDGE,
    INNER,
    NO_TOUCH,
    PATCH,
    TOP,
    N,
    Skin,
    press,
    press_at,
)
from tests.marks import slow
from tests.skins import feel_of

ROW_INSIDE = [BOARD.start + k for k in range(4, 8)]


@pytest.mark.parametrize("rail", [-250.1e3, TOP])
def test_zeros_from_before_a_rail_are_taken_up_again_under_the_same_finger(rail):
    skin = Skin(25, lambda raw, now, rng: raw.__setitem__(BOARD, rail) if 200 <= now < 260 else None)
    touch = press(ARM.tactel_s[INNER], ARM.tactel_a[INNER], 10.0)
    skin.read(cycles=100)
    skin.read(touch, cycles=100)
    before, doubt = skin.baseline.zeros[BOARD], skin.baseline.felt.doubt[BOARD].copy()
    skin.read(touch, cycles=60)
    assert set(skin.faulty) == set(range(BOARD.start, BOARD.stop))
    felt = skin.read(touch, cycles=60)
    assert skin.faulty == [], "it is used again, although the finger has not left"
    assert np.abs(felt - touch)[BOARD].max() < 6.0 * 200.0
    assert np.array_equal(skin.baseline.zeros[BOARD], before)
    assert (skin.baseline.felt.doubt[BOARD] > doubt).all()


@pytest.mark.slow
@pytest.mark.parametrize("was_touched", [False, True], ids=["free", "pressed"])
def test_corner_stuck_at_full_scale_is_missing_whatever_touches_beside_it(was_touched):
    """Beyond a corner there may be a second contact: only its onset shows that there is none."""
    for seed in range(27, 37):
        skin = Skin(seed, lambda raw, now, rng: raw.__setitem__(CORNER, TOP) if now >= 150 else None)
        skin.read(cycles=100)
        touch = press_at(CORNER + 5, skin.rng, 0.008)
        skin.read(touch if was_touched else NO_TOUCH, cycles=50 if was_touched else 60)
        for _ in range(60):
            assert np.isnan(skin.read(touch)[CORNER])
        assert skin.faulty == [CORNER]


def test_press_that_saturates_a_tactel_is_plausible():
    skin = Skin(3)
    skin.read(cycles=60)
    for tactel in (CORNER, EDGE, INNER):
        touch = press(ARM.tactel_s[tactel], ARM.tactel_a[tactel], 60.0)
        assert touch[tactel] > TOP
        skin.read(touch, cycles=100)
        skin.read(cycles=50)
        assert skin.faulty == []


DEAD_ONES = {
    "inside": ([INNER], 20, 1.0),
    "at an edge": ([EDGE], 20, 1.0),
    "at a corner": ([CORNER], 20, 0.9),
    "a row inside": (ROW_INSIDE, 10, 0.7),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tactels", "n_seeds", "share"),
    [
        pytest.param(*row, id=name, marks=[pytest.mark.slow] * name.startswith("at"))
        for name, row in DEAD_ONES.items()
    ],
)
def test_dead_tactel_is_named_within_ten_touches_of_its_neighbourhood(tactels, n_seeds, share):
    """Touches within a pitch of one; of a corner two in five are off the board, often felt by none."""
    n = []
    for seed in range(n_seeds):
        skin = Skin(
            seed, lambda raw, now, rng: raw.__setitem__(tactels, 200.0 * rng.standard_normal(len(tactels)))
        )
        skin.read(cycles=60)
        n_touches = 0
        while n_touches < 10 and not skin.faulty:
            skin.read(press_at(skin.rng.choice(tactels), skin.rng, 0.01), cycles=15)
            skin.read(cycles=15)
            n_touches += 1
        n.append(n_touches if skin.faulty else 11)
        assert set(skin.faulty) <= set(tactels)
    assert np.mean(np.array(n) <= 10) >= share


def test_dead_tactel_that_feels_again_is_plausible():
    skin = Skin(7, lambda raw, now, rng: raw.__setitem__(INNER, 0.0) if now < 600 else None)
    touch = press(ARM.tactel_s[INNER], ARM.tactel_a[INNER], 10.0)
    other = press(ARM.tactel_s[INNER] + 0.006, ARM.tactel_a[INNER], 10.0)
    skin.read(cycles=60)
    while skin.cycle < 560:
        skin.read(touch if skin.cycle < 300 else other, cycles=20)
        skin.read(cycles=20)
    assert skin.faulty == [INNER]
    skin.read(cycles=100)
    skin.read(touch, cycles=100)
    skin.read(cycles=20)
    assert skin.faulty == []


def test_jumping_tactel_is_named():
    skin = Skin(8, lambda raw, now, rng: raw.__setitem__(INNER, 80e3) if now % 10 == 0 else None)
    skin.cycles_to(TactelFault.JUMPING, INNER, most=100)
    assert skin.faulty == [INNER]


@pytest.mark.slow
@pytest.mark.parametrize("least", [800, *slow(3000)])
def test_no_false_alarm_of_touches_anywhere_one_to_three_at_once(least):
    n, n_missing, cycles = touched(11, least)
    assert n == 0
    assert n_missing <= 1e-4 * cycles * N, "readings that only look so are rare"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("radius_mm", "force"),
    [
        (1, 10.0),
        (3, 30.0),
        *slow((1, 3.0), (1, 30.0), (2, 3.0), (2, 10.0), (3, 5.0)),
    ],
)
def test_tactels_beside_a_narrow_tip_that_presses_one_place_again_and_again_are_not_faulty(radius_mm, force):
    feel = feel_of(ARM, Elastic(), 1e-3 * radius_mm)
    for seed in range(12):
        skin = Skin(1700 + seed)
        gain = 1.0 + GAIN_SD * skin.rng.standard_normal(N)
        near = [BOARD.start - 80 + 128 * k + skin.rng.integers(16) for k in range(3)]
        places = np.array([ARM.tactel_s[near], ARM.tactel_a[near]]) + skin.rng.uniform(-0.008, 0.008, (2, 3))
        touch = gain * feel(np.column_stack([*places, np.full(3, force)]))
        skin.read(cycles=30)
        for _ in range(5):
            skin.read(touch, cycles=30)
            skin.read(cycles=15)
        assert skin.faulty == []


@pytest.mark.parametrize("cycles", [1, 2, 3])
@pytest.mark.parametrize("tactel", [CORNER, INNER])
def test_short_taps_are_no_jumps_wherever_they_are(tactel, cycles):
    """Of a tip of 2 mm in the middle of a tactel, too: its neighbours feel a hundredth of it."""
    skin = Skin(31)
    touch = feel_of(ARM, Elastic(), 0.001)(np.array([[ARM.tactel_s[tactel], ARM.tactel_a[tactel], 5.0]]))
    skin.read(cycles=60)
    for _ in range(40):
        skin.read(touch, cycles=cycles)
        skin.read(cycles=10 - cycles)
        assert not skin.plausibility.faults.any()
    skin.read(touch, cycles=20)
    assert np.isfinite(skin.read(touch)[tactel])


def test_board_that_comes_to_full_scale_by_force_is_used_and_by_a_fault_of_its_supply_is_not():
    """What crushes a board must not end as no contact."""
    skin = Skin(32)
    skin.read(cycles=100)
    pressed = np.zeros(N)
    pressed[BOARD] = 2.0 * TOP
    for share in np.linspace(0.05, 1.0, 12):
        skin.read(share * pressed)
    for _ in range(100):
        assert np.isfinite(skin.read(pressed)[BOARD]).all()
        assert not skin.plausibility.is_withheld.any()
    skin.read(cycles=50)
    skin.read(pressed)
    assert skin.plausibility.is_withheld[PATCH]
