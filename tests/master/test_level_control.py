"""The pace of a master: budgets, levels and what is late, as pure logic and in a master on virtual time."""

from types import SimpleNamespace

import numpy as np
import pytest

from skinbus.estimate import LEVELS
from skinbus.master.level_control import (
    LOWER,
    WAIT_LEAST,
    WAIT_MOST,
    WINDOW,
    CycleFlags,
    LevelControl,
    split_flags,
    with_level,
)
from skinbus.objects.eds import load_eds
from skinbus.objects.profile import (
    index_of,
)
from tests.master.rig import MS, Rig
from tests.master.sdo_reads import number

PERIOD_NS = 20 * MS
OD = load_eds("skin-master", 127)


def make(level="full", budget_us=None, is_timed=True):
    return LevelControl(PERIOD_NS, 1_000_000, level, budget_us=budget_us, is_timed=is_timed)


def close(pace, *, strained=False, calm=True, late=False, n_contacts=3):
    """End one cycle; return its flags and what is said."""
    return pace.close(
        since_sync_ns=PERIOD_NS + 1 if late else PERIOD_NS // 2,
        estimate_ns=100_000 if calm else 900_000,
        publishing_ns=200_000,
        budget_us=1000.0,
        is_cut_short=strained,
        n_contacts=n_contacts,
    )


def levels(pace, cycles):
    """Levels of cycles, each given as settings of close."""
    said = []
    for settings in cycles:
        said.append(pace.level)
        close(pace, **settings)
    return said


STRAINED, CALM, BUSY = {"strained": True}, {}, {"calm": False}


# --- Budget ----------------------------------------------------------------------------------------


def test_budget_is_what_the_period_leaves_less_publishing():
    pace = make()
    for _ in range(3):
        close(pace, n_contacts=3)
    # 20 ms - 12 ms - 4 frames of 135 bits at 1 us - 0.2 ms of publishing
    assert pace.budget_us(12 * MS) == pytest.approx(20_000 - 12_000 - 4 * 135 - 200)
    assert pace.budget_us(30 * MS) == 0.0


# --- Level -----------------------------------------------------------------------------------------


def test_level_falls_step_by_step_under_load_and_never_below_the_cheapest():
    assert levels(make(), [STRAINED] * 10) == ["full"] * LOWER + ["fit"] * LOWER + ["kmeans"] * (
        10 - 2 * LOWER
    )


def test_level_rises_again_after_calm_and_never_above_the_one_asked_for():
    pace = make("fit")
    levels(pace, [STRAINED] * LOWER)
    assert levels(pace, [CALM] * (3 * WAIT_LEAST)) == ["kmeans"] * WAIT_LEAST + ["fit"] * (2 * WAIT_LEAST)


def test_machine_that_cannot_do_it_is_asked_ever_more_rarely():
    pace, changes, n = make("fit"), [], 0
    for n in range(100_000):
        # the dear level is always too slow here
        _, said = close(pace, strained=pace.level == "fit")
        changes += [n] if said.startswith("raised") else []
    gaps = np.diff(changes)
    assert len(changes) < 100_000 / WAIT_MOST + 10
    assert (gaps[1:] >= gaps[:-1]).all()
    assert gaps[-1] == pytest.approx(WAIT_MOST, abs=2 * WINDOW)


def test_cycle_flags_on_the_wire_have_the_level_beside_them():
    flags = CycleFlags.IMPAIRED | CycleFlags.OVERRUN
    for level in LEVELS:
        assert with_level(flags, level) < 256
        assert split_flags(with_level(flags, level)) == (flags, level)
    assert split_flags(int(flags)) == (flags, None)  # of a master that does not say


# --- In a master -----------------------------------------------------------------------------------


def get(master, name):
    return number(master, *index_of(OD, name))


@pytest.mark.slow
def test_cycle_that_is_late_is_counted_and_says_so():
    time = SimpleNamespace(ns=10**12)
    timed = Rig("forearm", stopwatch=lambda: time.ns)
    timed.run(500)
    before = get(timed.master, "Cycle/Overruns")
    real = timed.master.cycle.run

    def slow(*args, **more):
        time.ns += 2 * PERIOD_NS
        return real(*args, **more)

    timed.master.cycle.run = slow
    (report,), _, _ = timed.run(20)
    timed.master.cycle.run = real
    assert CycleFlags.OVERRUN in report.flags
    assert report.latency_ns > 2 * PERIOD_NS
    assert get(timed.master, "Cycle/Overruns") == before + 1
    (report,), _, _ = timed.run(20)
    assert CycleFlags.OVERRUN not in report.flags
