"""Plausibility: tactels that cannot be right are named in time and come back; healthy ones are left alone."""

import numpy as np
import pytest

from skinbus.estimate import TactelFault
from skinbus.sim.laws import Elastic
from tests.estimate.false_alarms import GAIN_SD, touched
from tests.estimate.judged_skin import (
    APART,
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
from tests.skins import feel_of


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


@pytest.mark.parametrize("was_touched", [False, True], ids=["free", "pressed"])
def test_corner_stuck_at_full_scale_is_missing_whatever_touches_beside_it(was_touched):
    """Beyond a corner there may be a second contact: only its onset shows that there is none."""
    corners = 16 * APART
    for seed in (27, 28):
        skin = Skin(seed, lambda raw, now, rng: raw.__setitem__(corners, TOP) if now >= 150 else None)
        skin.read(cycles=100)
        touch = sum(press_at(corner + 5, skin.rng, 0.008) for corner in corners)
        skin.read(touch if was_touched else NO_TOUCH, cycles=50 if was_touched else 60)
        for _ in range(60):
            assert np.isnan(skin.read(touch)[corners]).all()
        assert skin.faulty == corners.tolist()


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
    "inside": ([5], (0, 1), 1.0),
    "at an edge": ([1], (0, 1, 2), 1.0),
    "at a corner": ([0], (0, 1, 2), 0.9),
    "a row inside": ([4, 5, 6, 7], (0, 1), 0.7),
}


@pytest.mark.slow
@pytest.mark.parametrize(("tactels", "seeds", "share"), DEAD_ONES.values(), ids=DEAD_ONES)
def test_dead_tactel_is_named_within_ten_touches_of_its_neighbourhood(tactels, seeds, share):
    """Touches within a pitch of one; of a corner two in five are off the board, often felt by none."""
    dead, named = 16 * APART[:, None] + tactels, []
    for seed in seeds:
        skin = Skin(
            seed, lambda raw, now, rng: raw.__setitem__(dead, 200.0 * rng.standard_normal(dead.shape))
        )
        skin.read(cycles=60)
        for pair in dead.reshape(-1, 2, len(tactels)):
            for own in [*pair] * 10:
                skin.read(press_at(skin.rng.choice(own), skin.rng, 0.01), cycles=15)
                if skin.plausibility.faults[pair].any(axis=1).all():
                    break
        named.extend(skin.plausibility.faults[dead].any(axis=1))
        assert set(skin.faulty) <= set(dead.ravel())
    assert np.mean(named) >= share


def test_dead_tactel_that_feels_again_is_plausible():
    skin = Skin(7, lambda raw, now, rng: raw.__setitem__(INNER, 0.0) if now < 400 else None)
    touch = press(ARM.tactel_s[INNER], ARM.tactel_a[INNER], 10.0)
    other = press(ARM.tactel_s[INNER] + 0.006, ARM.tactel_a[INNER], 10.0)
    skin.read(cycles=60)
    while skin.cycle < 380:
        skin.read(touch if skin.cycle < 200 else other, cycles=20)
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
def test_no_false_alarm_of_touches_anywhere_one_to_three_at_once():
    n, n_missing, cycles = touched(11, 3000)
    assert n == 0
    assert n_missing <= 1e-4 * cycles * N, "readings that only look so are rare"


@pytest.mark.slow
@pytest.mark.parametrize("radius_mm", [1, 2, 3])
def test_tactels_beside_a_narrow_tip_that_presses_one_place_again_and_again_are_not_faulty(radius_mm):
    feel = feel_of(ARM, Elastic(), 1e-3 * radius_mm)
    for seed in range(6):
        skin = Skin(1700 + seed)
        gain = 1.0 + GAIN_SD * skin.rng.standard_normal(N)
        near = 16 * np.array([[0, 8, 16], [4, 12, 20]]) + skin.rng.integers(16, size=(2, 3))
        places = np.stack([ARM.tactel_s[near], ARM.tactel_a[near]], -1)
        places += skin.rng.uniform(-0.008, 0.008, places.shape)
        touches = [gain * feel(np.column_stack([three, np.ones(3)])) for three in places]
        skin.read(cycles=30)
        for force in (3.0, 10.0, 30.0) * 2:
            for touch in touches:
                skin.read(force * touch, cycles=30)
        assert skin.faulty == []


@pytest.mark.parametrize("cycles", [1, 2, 3])
@pytest.mark.parametrize("tactel", [CORNER, INNER])
def test_short_taps_are_no_jumps_wherever_they_are(tactel, cycles):
    """Of a tip of 2 mm in the middle of a tactel, too: its neighbours feel a hundredth of it."""
    skin = Skin(31)
    touch = feel_of(ARM, Elastic(), 0.001)(np.array([[ARM.tactel_s[tactel], ARM.tactel_a[tactel], 5.0]]))
    skin.read(cycles=60)
    for _ in range(20):
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
