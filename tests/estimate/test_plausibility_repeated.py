"""Readings that come again bit by bit are not those of a new sample; what may be chance is not claimed."""

import numpy as np
import pytest

from skinbus.estimate import TactelFault
from tests.estimate.false_alarms import touched
from tests.estimate.judged_skin import (
    APART,
    ARM,
    BOARD,
    NO_TOUCH,
    PATCH,
    TOP,
    TRANSDUCER,
    Skin,
    coarse_arm,
    press,
    press_at,
)

STEP = TRANSDUCER.resolution


def press_inside(patch):
    """Pa on every tactel of a press of 20 N on a tactel inside a board."""
    inner = 16 * patch + 5
    return press(ARM.tactel_s[inner], ARM.tactel_a[inner], 20.0)


PRESS = press_inside(PATCH)


class Frozen:
    """A board whose converter stops for some cycles, once or again and again."""

    def __init__(self, begin, length, tactels=BOARD, every=10**9):
        self.begin, self.length, self.tactels, self.every = begin, length, tactels, every

    def __call__(self, raw, now, rng):
        n = (now - self.begin) % self.every
        if n == 0:
            self.kept = raw[self.tactels].copy()
        if n < self.length and now >= self.begin:
            raw[self.tactels] = self.kept


def withheld(skin, touch, cycles):
    """Whether the board was withheld, by cycle."""
    said = []
    for _ in range(cycles):
        skin.read(touch)
        said.append(bool(skin.plausibility.is_withheld[PATCH]))
        assert skin.plausibility.is_withheld.sum() == said[-1], "the other boards are alive"
    return said


@pytest.mark.parametrize("touch", [NO_TOUCH, PRESS], ids=["free", "pressed"])
def test_frozen_board_is_withheld_from_its_first_repetition_to_its_first_new_sample_and_named(touch):
    skin = Skin(11, Frozen(150, 250))
    skin.read(cycles=100)
    assert not any(withheld(skin, touch, 51))
    assert all(withheld(skin, touch, 49))
    assert (skin.plausibility.faults[BOARD] & TactelFault.FROZEN).all(), "within a second"
    assert np.isnan(skin.read(touch)[BOARD]).all(), "what it reads is missing"
    assert all(withheld(skin, touch, 199))
    assert not any(withheld(skin, touch, 50))
    skin.read(cycles=100)
    assert skin.faulty == []


def test_board_that_froze_while_it_was_not_used_is_withheld_when_it_is_used_again():
    skin = Skin(11, Frozen(150, 250))
    skin.read(cycles=140)
    skin.fresh[PATCH] = False
    skin.read(PRESS, cycles=20)
    skin.fresh[PATCH] = True
    assert all(withheld(skin, PRESS, 240))
    assert not any(withheld(skin, PRESS, 50))


@pytest.mark.slow
def test_noise_of_less_than_a_count_makes_no_false_alarm_although_more_is_declared():
    """The touch moves the readings to other parts of a step, where they change less often."""

    def quiet(raw, now, rng):
        at = where + 40.0 * (now % 200 > 100)
        raw[own] = np.rint(at + noise * rng.standard_normal(len(at))) * STEP

    own, noise = np.isin(ARM.tactel_patch, APART[:4]), np.repeat([0.05, 0.15, 0.3, 0.6], 16)
    where = np.random.default_rng(15).uniform(-0.5, 0.5, 64)
    skin = Skin(15, quiet)
    for _ in range(4000):
        skin.read()
        assert not skin.plausibility.is_withheld.any()


def test_board_without_noise_that_is_tapped_at_a_steady_rate_is_not_withheld():
    def without_noise(raw, now, rng):
        raw[BOARD] = np.rint((skin.zeros + PRESS * (now // 10 % 2))[BOARD] / STEP) * STEP

    skin = Skin(28, without_noise)
    assert not any(withheld(skin, NO_TOUCH, 500))


@pytest.mark.slow
def test_board_that_repeats_its_readings_now_and_then_is_withheld_whenever_it_does():
    patches, shares = APART[:3], (0.1, 0.3, 0.9)
    boards = [ARM.tactels_of(p) for p in patches]

    def repeat(raw, now, rng):
        again[:] = (rng.random(3) < shares) & (now > 100)
        for k, board in enumerate(boards):
            if again[k]:
                raw[board] = kept[k]
            kept[k] = raw[board]

    again, kept = np.zeros(3, np.bool_), np.zeros((3, 16))
    skin, touch = Skin(23, repeat), sum(press_inside(p) for p in patches)
    skin.read(cycles=100)
    for _ in range(2000):
        skin.read(touch)
        assert np.flatnonzero(skin.plausibility.is_withheld).tolist() == patches[again].tolist()


@pytest.mark.parametrize("rail", [-250.1e3, TOP])
def test_board_at_a_rail_is_withheld_at_once_and_named_within_half_a_second_and_comes_back(rail):
    skin = Skin(18, lambda raw, now, rng: raw.__setitem__(BOARD, rail) if 100 <= now < 400 else None)
    skin.read(cycles=100)
    assert all(withheld(skin, NO_TOUCH, 20)) or rail < 0.0, "below zero there is no contact to withhold"
    assert skin.cycles_to(TactelFault.RAIL, BOARD) <= 5
    skin.read(cycles=400 - skin.cycle)
    assert not any(withheld(skin, NO_TOUCH, 200))
    assert skin.faulty == []
    assert np.abs(skin.baseline.zeros - skin.zeros)[BOARD].max() < 150.0


@pytest.mark.slow
def test_no_number_of_freezes_hides_the_next():
    """Half of a board each; of so many cycles, with so many between them."""
    lengths = [(length, length + pause) for length in (6, 12, 19, 22, 24, 200) for pause in (5, 100)]
    freezes = [Frozen(1500, n, slice(16 * p, 16 * p + 8), every) for p, (n, every) in enumerate(lengths)]
    skin = Skin(20, lambda *now: [freeze(*now) for freeze in freezes])
    touch = sum(press_inside(p) for p in range(len(freezes)))
    skin.read(cycles=1500)
    for n in range(2000):
        felt = skin.read(touch)
        for it in freezes:
            assert np.isnan(felt[it.tactels]).all() or not 0 < n % it.every < it.length
    assert not skin.plausibility.faults[: 4 * 16].any(), "of freezes of 6 and 12 cycles"


@pytest.mark.parametrize("ramp", [np.linspace(0.1, 1.0, 6), np.linspace(1.0, 0.1, 6)], ids=["rises", "ends"])
def test_tactel_that_stops_in_a_touch_is_missing_at_its_fourth_repetition(ramp):
    for seed in (50, 51):
        skin = Skin(seed)
        skin.read(cycles=100)
        tactels = 16 * APART + skin.rng.integers(16, size=len(APART))
        touch = sum(press_at(tactel, skin.rng, 0.006) for tactel in tactels)
        skin.read(ramp[0] * touch, cycles=20)
        skin.mend = Frozen(skin.cycle, 10**9, tactels)
        skin.read(ramp[0] * touch)
        used = np.isfinite([skin.read(now * touch)[tactels] for now in ramp[1:]])
        assert used.sum(axis=0).max() <= 3


@pytest.mark.slow
@pytest.mark.parametrize("bits", [8, 12])
def test_coarse_steps_make_no_false_alarm_in_touches(bits):
    arm = coarse_arm(bits)
    n, n_missing, cycles = touched(31, 1000, arm)
    assert n == 0
    assert n_missing <= 1e-4 * cycles * arm.n_tactels, "readings that only look so are rare"
