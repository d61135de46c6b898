"""Readings that come again bit by bit are not those of a new sample; what may be chance is not claimed."""

import numpy as np
import pytest

from skinbus.estimate import TactelFault
from tests.estimate.false_alarms import touched
from tests.estimate.judged_skin import (
    ARM,
    BOARD,
    INNER,
    NO_TOUCH,
    PATCH,
    TOP,
    TRANSDUCER,
    Skin,
    coarse_arm,
    press,
    press_at,
)
from tests.marks import slow

STEP = TRANSDUCER.resolution
PRESS = press(ARM.tactel_s[INNER], ARM.tactel_a[INNER], 20.0)


class Frozen:
    """A board whose converter stops for some cycles."""

    def __init__(self, begin, end, tactels=BOARD):
        self.begin, self.end, self.tactels = begin, end, tactels
        self.kept = None

    def __call__(self, raw, now, rng):
        if now == self.begin:
            self.kept = raw[self.tactels].copy()
        if self.begin <= now < self.end:
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
    skin = Skin(11, Frozen(150, 400))
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
    skin = Skin(11, Frozen(150, 400))
    skin.read(cycles=140)
    skin.fresh[PATCH] = False
    skin.read(PRESS, cycles=20)
    skin.fresh[PATCH] = True
    assert all(withheld(skin, PRESS, 240))
    assert not any(withheld(skin, PRESS, 50))


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.15, 0.3, *slow(0.05, 0.6)])
def test_noise_of_less_than_a_count_makes_no_false_alarm_although_more_is_declared(noise):
    """The touch moves the readings to other parts of a step, where they change less often."""

    def quiet(raw, now, rng):
        at = where[int(now % 200 > 100)]
        raw[BOARD] = np.rint(at + noise * rng.standard_normal(len(at))) * STEP

    rng = np.random.default_rng(15)
    n = BOARD.stop - BOARD.start
    where = rng.uniform(-0.5, 0.5, n), 40.0 + rng.uniform(-0.5, 0.5, n)
    skin = Skin(15, quiet)
    assert sum(withheld(skin, NO_TOUCH, 4000)) == 0


def test_board_without_noise_that_is_tapped_at_a_steady_rate_is_not_withheld():
    def without_noise(raw, now, rng):
        raw[BOARD] = np.rint((skin.zeros + PRESS * (now // 10 % 2))[BOARD] / STEP) * STEP

    skin = Skin(28, without_noise)
    assert not any(withheld(skin, NO_TOUCH, 1000))


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.1, 0.3, 0.9])
def test_board_that_repeats_its_readings_now_and_then_is_withheld_whenever_it_does(share):
    repeats = []

    def repeat(raw, now, rng):
        repeats.append(bool(now > 100 and rng.random() < share))
        if repeats[-1]:
            raw[BOARD] = kept[0]
        kept[0] = raw[BOARD].copy()

    kept = [np.zeros(BOARD.stop - BOARD.start)]
    skin = Skin(23, repeat)
    skin.read(cycles=100)
    assert withheld(skin, PRESS, 2000) == repeats[100:]


@pytest.mark.parametrize("rail", [-250.1e3, TOP])
def test_board_at_a_rail_is_withheld_at_once_and_named_within_half_a_second_and_comes_back(rail):
    skin = Skin(18, lambda raw, now, rng: raw.__setitem__(BOARD, rail) if 100 <= now < 600 else None)
    skin.read(cycles=100)
    assert all(withheld(skin, NO_TOUCH, 20)) or rail < 0.0, "below zero there is no contact to withhold"
    assert skin.cycles_to(TactelFault.RAIL, BOARD) <= 5
    skin.read(cycles=600 - skin.cycle)
    assert not any(withheld(skin, NO_TOUCH, 200))
    assert skin.faulty == []
    assert np.abs(skin.baseline.zeros - skin.zeros)[BOARD].max() < 150.0


@pytest.mark.slow
@pytest.mark.parametrize("length", [6, 19, 22, *slow(12, 24, 200)])
@pytest.mark.parametrize("pause", [5, 100])
def test_no_number_of_freezes_hides_the_next(length, pause):
    skin = Skin(20)
    skin.read(cycles=1500)
    half = slice(BOARD.start, BOARD.start + 8)
    for _ in range(4 if pause > 5 else 40):
        skin.mend = Frozen(skin.cycle, skin.cycle + length, half)
        skin.read(PRESS)
        for _ in range(length - 1):
            assert np.isnan(skin.read(PRESS)[half]).all()
        skin.read(PRESS, cycles=pause)
    if length <= 12:
        assert skin.faulty == []


@pytest.mark.parametrize("ramp", [np.linspace(0.1, 1.0, 6), np.linspace(1.0, 0.1, 6)], ids=["rises", "ends"])
def test_tactel_that_stops_in_a_touch_is_missing_at_its_fourth_repetition(ramp):
    n_used = []
    for seed in range(50, 60):
        skin = Skin(seed)
        skin.read(cycles=100)
        tactel = int(BOARD.start + skin.rng.integers(16))
        touch = press_at(tactel, skin.rng, 0.006)
        skin.read(ramp[0] * touch, cycles=20)
        skin.mend = Frozen(skin.cycle, 10**9, slice(tactel, tactel + 1))
        skin.read(ramp[0] * touch)
        used = [bool(np.isfinite(skin.read(now * touch)[tactel])) for now in ramp[1:]]
        n_used.append(sum(used))
    assert max(n_used) <= 3


@pytest.mark.slow
@pytest.mark.parametrize("bits", [8, 12])
def test_coarse_steps_make_no_false_alarm_in_touches(bits):
    arm = coarse_arm(bits)
    n, n_missing, cycles = touched(31, 1000, arm)
    assert n == 0
    assert n_missing <= 1e-4 * cycles * arm.n_tactels, "readings that only look so are rare"
