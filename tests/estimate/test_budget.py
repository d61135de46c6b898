"""The budget of a cycle: never far exceeded, never a touch lost to it, and always said."""

import ctypes
import time

import numpy as np
import pytest
from numba import cfunc, types

from skinbus.estimate import Clock, Estimator, Quality
from skinbus.model import Cone
from tests.bench.estimator import measure
from tests.hard.test_extremes import random_readings
from tests.marks import fits, levels
from tests.skins import SKINS, cone_forearm

TOUCHES = [(0.025, 0.0), (0.0255, 0.1275), (0.051, -0.1), (0.077, 0.0765), (0.128, -0.05), (0.04, 0.012)]
"""(s, a) in m: on seams, inside patches, and two close together."""
STEP = 600
"""Pressures evaluated between two looks at the budget, and to write what is found: a few times all
tactels of the largest group here, 40 tactels for two contacts."""


LAST_STEP_US = 5
"""A cycle begins no step that would take longer than is left: of some 100 pressures here."""


BUDGET = 20_000
"""Of work; forces of up to 10 kN on all boards make a cycle take a hundred times as much."""


class FakeClock:
    """A clock that goes on by 1 us each time it is read, and counts how often."""

    def __init__(self):
        self.n_read = 0
        prototype = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.POINTER(ctypes.c_int64))
        self._function = prototype(self._read)  # kept: the address is that of this object
        self.clock = Clock(ctypes.cast(self._function, ctypes.c_void_p).value, 7)

    def _read(self, clock_id, answer):
        assert clock_id == 7
        self.n_read += 1
        answer[0], answer[1] = divmod(1_700_000_000 * 10**9 + 1000 * self.n_read, 10**9)
        return 0


read_time = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.CPointer(types.int64)))
has_lock = types.ExternalFunction("PyGILState_Check", types.int32())


@cfunc("int32(int32, CPointer(int64))")
def time_with_lock(clock_id, answer):
    """Read a clock that goes on while its thread holds Python's lock, and says 0 while it does not."""
    read_time(clock_id, answer)
    answer[0] *= has_lock()
    answer[1] *= has_lock()
    return 0


@pytest.fixture(scope="module")
def arm():
    return cone_forearm()


@pytest.fixture(scope="module")
def pressures(arm):
    """(n_tactels,) Pa of six touches, with noise; seed 31."""
    law = Cone()
    clean = sum(law.pressure(arm.distance(slice(None), s, a), 8.0) for s, a in TOUCHES)
    return clean + 200.0 * np.random.default_rng(31).standard_normal(arm.n_tactels)


def columns(contacts):
    return [getattr(contacts, name) for name in ("s", "a", "force", "patch", "level", "quality", "status")]


def same(one, other):
    return all(np.array_equal(a, b) for a, b in zip(columns(one), columns(other), strict=True))


def distances(arm, contacts):
    """(n_touches, n_contacts) m."""
    touches = np.array(TOUCHES)
    return arm.links[0].surface.distance(touches[:, :1], touches[:, 1:], contacts.s, contacts.a)


def test_no_clock_is_read_without_a_budget_in_time(arm, pressures):
    fake = FakeClock()
    Estimator(arm, "full", clock=fake.clock, budget_work=5000).update(pressures, 0)
    assert fake.n_read == 0


@fits
@pytest.mark.parametrize("budget_us", [0, 1, 3, 10, 30, 100, 300])
def test_clock_is_looked_at_until_time_is_out_and_then_never_again(arm, pressures, level, budget_us):
    fake = FakeClock()
    contacts = Estimator(arm, level, clock=fake.clock, budget_us=budget_us).update(pressures, 0)
    # the first look begins the time; each later one takes 1 us, and the last finds it used up
    is_out = (contacts.quality & Quality.OVER_BUDGET).any()
    assert fake.n_read <= 1 + max(budget_us, 1)
    assert fake.n_read > budget_us - LAST_STEP_US or not is_out
    assert is_out or budget_us > 30


def test_levels_run_without_pythons_lock(arm, pressures):
    seen = (ctypes.c_int64 * 2)()
    ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.c_void_p)(time_with_lock.address)(1, seen)
    assert seen[1], "this call holds it"
    clock = Clock(time_with_lock.address, time.CLOCK_MONOTONIC)
    contacts = Estimator(arm, "full", clock=clock, budget_us=0.001).update(pressures, 0)
    assert not (contacts.quality & Quality.OVER_BUDGET).any()


@fits
def test_no_budget_is_exceeded_by_more_than_a_step_loses_a_touch_or_is_used_up_in_silence(
    arm, pressures, level
):
    free = Estimator(arm, level)
    answer, n_hurried = free.update(pressures, 0), 0
    seen = distances(arm, Estimator(arm, "kmeans").update(pressures, 0)).min(axis=1) < 0.015
    assert seen.sum() >= 5  # two are so close together that K-means may see one
    for budget in range(0, max(free.n_evaluated + 500, 6000), 100):
        hurried = Estimator(arm, level, budget_work=budget)
        contacts = hurried.update(pressures, 0)
        assert hurried.n_evaluated <= budget + STEP
        assert (distances(arm, contacts).min(axis=1)[seen] < 0.015).all()
        over = (contacts.quality & Quality.OVER_BUDGET) > 0
        assert over[contacts.level != level].all()
        n_hurried += over.any()
        assert over.any() or same(contacts, answer)
    assert n_hurried > 10


@fits
def test_whatever_is_read_little_is_left_to_do_when_the_budget_is_used_up(arm, level):
    estimator = Estimator(arm, level, budget_work=BUDGET)
    largest = 8 * arm.n_tactels  # a step of a fit of eight contacts on the whole arm
    rng, most = np.random.default_rng(33), 0.0
    for t in range(120):
        estimator.update(random_readings(arm, rng), t)
        most = max(most, (estimator.n_evaluated - BUDGET) / largest)
    assert 0.0 < most < 4.0


def test_budget_in_work_gives_the_same_bits_every_time(arm, pressures):
    for budget in (300, 3000):
        one, other = (Estimator(arm, "full", budget_work=budget).update(pressures, 0) for _ in range(2))
        assert same(one, other)


def test_next_cycle_has_a_budget_of_its_own(arm, pressures):
    estimator = Estimator(arm, "fit", clock=FakeClock().clock)
    answer = estimator.update(pressures, 0)
    hurried = estimator.update(pressures, 0, budget_us=0)
    assert (hurried.level == "kmeans").all()
    assert same(estimator.update(pressures, 0), answer)
    assert same(estimator.update(pressures, 0, budget_us=1e9), answer)  # time that nobody could need


def test_budget_in_time_is_never_measured_by_a_clock_that_was_not_asked_for(arm, pressures):
    with pytest.raises(ValueError, match="needs a clock"):
        Estimator(arm, "fit", clock=None, budget_us=100)
    with pytest.raises(ValueError, match="needs a clock"):
        Estimator(arm, "fit", clock=None).update(pressures, 0, budget_us=100)
    assert (Estimator(arm, "fit", budget_us=0).update(pressures, 0).level == "kmeans").all()


@levels
def test_cheaper_level_for_a_cycle_gives_what_an_estimator_of_that_level_gives(arm, pressures, level):
    own = Estimator(arm, level).update(pressures, 0)
    assert same(Estimator(arm, "full").update(pressures, 0, level=level), own)


def test_wrong_budgets_and_levels_are_refused(arm, pressures):
    for settings in ({"budget_us": -1.0}, {"budget_us": np.nan}, {"budget_us": 1e13}, {"budget_work": -1}):
        with pytest.raises(ValueError, match="budget"):
            Estimator(arm, **settings)
    estimator = Estimator(arm, "fit")
    with pytest.raises(ValueError, match="budget"):
        estimator.update(pressures, 0, budget_us=-1.0)
    for level in ("full", "best"):
        with pytest.raises(ValueError, match="kmeans, fit; got"):
            estimator.update(pressures, 0, level=level)


def test_contacts_that_have_come_together_are_over_budget_until_they_are_searched_together():
    rng = np.random.default_rng(31)
    touches = rng.uniform((-0.02, -0.02, 2.0), (0.02, 0.02, 20.0), (4, 3))
    skin = SKINS["box"](rng)
    contacts = Estimator(skin.arm, budget_work=2000).update(skin.feel(touches), 0)
    assert (contacts.quality & Quality.OVER_BUDGET).all()


@fits
def test_covariance_of_what_is_cut_short_includes_rivals(level):
    found = measure("box forearm", "seam", 30, 35, levels=(level,), budget_work=400)[level]
    assert np.mean([square for rows, *_ in found for *_, square, flags in rows]) < 2.0
