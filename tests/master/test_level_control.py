"""The pace of a master: budgets, levels and what is late, as pure logic and in a master on virtual time."""

import ctypes

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.estimate import LEVELS, Clock, Quality
from skinbus.master import Master
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
    BUDGET_US,
    CUT_SHORT,
    CYCLE_FLAGS,
    LEVEL,
    MAX_CONTACTS,
    OVERRUNS,
    contact,
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


def test_budget_asked_for_is_never_more_than_what_is_left():
    pace = make(budget_us=800.0)
    assert pace.budget_us(5 * MS) == 800.0
    assert pace.budget_us(19_600_000) == pytest.approx(400 - 135)


def test_no_budget_without_a_clock():
    assert make(is_timed=False).budget_us(19 * MS) is None
    with pytest.raises(ValueError, match="clock"):
        Master(load_arm("pad"), budget_us=500.0)


def test_slow_publishing_is_remembered_for_a_while():
    pace = make()
    slow = {"since_sync_ns": MS, "estimate_ns": 0, "budget_us": None, "is_cut_short": False, "n_contacts": 0}
    pace.close(**slow, publishing_ns=3 * MS)
    after = pace.budget_us(0)
    for _ in range(200):
        pace.close(**slow, publishing_ns=MS)
    assert after == pytest.approx(20_000 - 135 - 3000)
    assert pace.budget_us(0) == pytest.approx(20_000 - 135 - 1000)


# --- Level -----------------------------------------------------------------------------------------


def test_one_or_two_strained_cycles_lower_nothing():
    pattern = [STRAINED, STRAINED, *[BUSY] * (WINDOW - 2)]
    assert set(levels(make(), pattern * 20)) == {"full"}


def test_level_falls_step_by_step_under_load_and_never_below_the_cheapest():
    assert levels(make(), [STRAINED] * 10) == ["full"] * LOWER + ["fit"] * LOWER + ["kmeans"] * (
        10 - 2 * LOWER
    )


def test_late_cycles_are_load_too():
    assert levels(make("fit"), [{"late": True}] * (LOWER + 1))[-1] == "kmeans"


def test_level_rises_again_after_calm_and_never_above_the_one_asked_for():
    pace = make("fit")
    levels(pace, [STRAINED] * LOWER)
    assert levels(pace, [CALM] * (3 * WAIT_LEAST)) == ["kmeans"] * WAIT_LEAST + ["fit"] * (2 * WAIT_LEAST)


def test_level_stays_low_while_there_is_no_room_for_more():
    pace = make("fit")
    levels(pace, [STRAINED] * LOWER)
    assert set(levels(pace, [BUSY] * (10 * WAIT_LEAST))) == {"kmeans"}


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


def calm_cycles_until_raised(pace):
    """Let calm cycles pass until the level is fit again; return how many it took."""
    n = 0
    while pace.level != "fit":
        close(pace)
        n += 1
    return n


def test_raise_that_lasts_is_trusted_sooner_the_next_time():
    pace = make("fit")
    for _ in range(4):  # each but the first too early
        levels(pace, [STRAINED] * LOWER)
        waited = calm_cycles_until_raised(pace)
    assert waited > WAIT_LEAST
    levels(pace, [CALM] * WAIT_MOST)  # it lasts
    levels(pace, [STRAINED] * LOWER)
    assert calm_cycles_until_raised(pace) < waited


def test_level_is_what_is_compiled_until_more_is():
    pace = LevelControl(
        PERIOD_NS, 1_000_000, "full", budget_us=None, is_timed=True, available="kmeans"
    )  # fmt: skip
    assert set(levels(pace, [CALM] * (3 * WAIT_LEAST))) == {"kmeans"}
    assert close(pace)[0] & CycleFlags.LOWERED
    pace.allow("fit")
    assert close(pace)[1] == "raised to fit: its kernels are compiled"
    assert set(levels(pace, [CALM] * (3 * WAIT_LEAST))) == {"fit"}
    pace.allow("full")
    assert pace.level == "full"
    close(pace)
    assert not close(pace)[0] & CycleFlags.LOWERED


@pytest.mark.parametrize(
    ("budget_us", "remedy"), [(None, "a faster processor"), (800.0, "the budget is 800 us, a larger one")]
)
def test_what_lowers_the_level_says_what_would_help(budget_us, remedy):
    pace = make(budget_us=budget_us)
    said = [text for _ in range(60) if (text := close(pace, strained=True)[1])]
    assert [text.split(":")[0] for text in said] == [
        "lowered to fit",
        "lowered to kmeans",
        "too slow for kmeans",
    ]
    assert all(remedy in text for text in said)


def test_a_master_that_is_too_slow_at_the_lowest_level_says_so_once_until_it_has_been_calm():
    pace = make("kmeans")
    for _ in range(3):
        said = [text for _ in range(200) if (text := close(pace, late=True)[1])]
        assert len(said) == 1
        assert said[0].startswith("too slow for kmeans")
        assert not any(close(pace)[1] for _ in range(2 * WAIT_LEAST))


def test_cycle_flags_on_the_wire_have_the_level_beside_them():
    flags = CycleFlags.IMPAIRED | CycleFlags.OVERRUN
    for level in LEVELS:
        assert with_level(flags, level) < 256
        assert split_flags(with_level(flags, level)) == (flags, level)
    assert split_flags(int(flags)) == (flags, None)  # of a master that does not say


def test_compiled_level_above_the_one_asked_for_is_not_used():
    pace = make("fit")
    pace.allow("full")
    assert pace.level == "fit"
    assert close(pace)[1] == ""


def test_same_cycles_give_the_same_levels():
    rng = np.random.default_rng(4)
    cycles = [{"strained": bool(a), "calm": bool(b)} for a, b in rng.random((5000, 2)) < (0.1, 0.9)]
    assert levels(make(), cycles) == levels(make(), cycles)


# --- Late ------------------------------------------------------------------------------------------


def test_overruns_rise_in_exactly_the_cycles_that_say_overrun():
    pace, rng = make(), np.random.default_rng(6)
    for _ in range(2000):
        before = pace.overruns
        pace.sync(
            PERIOD_NS * (1 if rng.random() < 0.9 else int(rng.integers(2, 5))) + int(rng.normal(0, 1e6))
        )
        flags, _ = close(pace, late=bool(rng.random() < 0.1))
        assert (pace.overruns > before) == (CycleFlags.OVERRUN in flags)


def test_every_period_without_contacts_in_time_counts_once():
    pace = make()
    pace.sync(PERIOD_NS)
    close(pace, late=True)
    pace.sync(4 * PERIOD_NS)  # the late one took so long that three SYNCs were left out
    close(pace)
    pace.sync(PERIOD_NS)
    close(pace)
    assert pace.overruns == 4


# --- In a master -----------------------------------------------------------------------------------


class FakeTime:
    """A clock that Python and compiled code read, each look at it taking ``look_us``."""

    class Pair(ctypes.Structure):
        _fields_ = (("seconds", ctypes.c_int64), ("ns", ctypes.c_int64))

    def __init__(self):
        self.ns, self.look_us = 10**12, 0.0
        self._function = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.POINTER(self.Pair))(self._read)
        self.clock = Clock(ctypes.cast(self._function, ctypes.c_void_p).value)

    def stopwatch(self):
        return self.ns

    def _read(self, clock_id, answer):
        self.ns += round(1000 * self.look_us)
        answer[0].seconds, answer[0].ns = divmod(self.ns, 10**9)
        return 0


def get(master, name):
    return number(master, *index_of(OD, name))


@pytest.fixture
def timed():
    """A forearm with a master at level full whose estimator may take 500 us, and four touches."""
    time = FakeTime()
    rig = Rig("forearm", level="full", budget_us=500.0, clock=time.clock, stopwatch=time.stopwatch)
    rig.time = time
    rig.run(2500)
    return rig


@pytest.mark.slow
def test_load_lowers_the_level_and_calm_raises_it_again(timed):
    assert timed.reports[-1].level == "full"
    timed.time.look_us = 200.0  # three steps of a fit and time is out
    reports, events, _ = timed.run(1000)
    assert [r.level for r in reports][: 2 * LOWER : LOWER] == ["full", "fit"]
    assert reports[-1].level == "kmeans"
    assert all(Quality.OVER_BUDGET & int(q) for q in reports[0].contacts.quality)
    assert [e.detail.split(":")[0] for e in events if e.kind == "level"] == [
        "lowered to fit",
        "lowered to kmeans",
        "too slow for kmeans",
    ]
    timed.time.look_us = 0.01
    reports, events, _ = timed.run(4000)
    assert [e.detail.split(":")[0] for e in events if e.kind == "level"] == [
        "raised to fit",
        "raised to full",
    ]
    assert reports[-1].level == "full"


@pytest.mark.slow
def test_contacts_and_cycle_say_their_level_to_any_client(timed):
    master = timed.master
    timed.time.look_us = 200.0
    timed.run(60)
    cut = get(master, CUT_SHORT)
    timed.run(1000)
    assert (get(master, LEVEL), get(master, BUDGET_US)) == (LEVELS.index("kmeans"), 500)
    assert get(master, CUT_SHORT) >= cut > 0
    assert CycleFlags.LOWERED & get(master, CYCLE_FLAGS)
    records = master.device.values.rows(OD[contact(1).object].index, MAX_CONTACTS)
    shown = records[records["Id"] > 0]
    assert len(shown)
    assert set(shown["Level"].tolist()) == {LEVELS.index("kmeans")}


@pytest.mark.slow
def test_cycle_that_is_late_is_counted_and_says_so(timed):
    before = get(timed.master, OVERRUNS)
    real = timed.master.cycle.run

    def slow(*args):
        timed.time.ns += 2 * PERIOD_NS
        return real(*args)

    timed.master.cycle.run = slow
    (report,), _, _ = timed.run(20)
    timed.master.cycle.run = real
    assert CycleFlags.OVERRUN in report.flags
    assert report.latency_ns > 2 * PERIOD_NS
    assert get(timed.master, OVERRUNS) == before + 1
    (report,), _, _ = timed.run(20)
    assert CycleFlags.OVERRUN not in report.flags


@pytest.mark.slow
def test_master_without_a_clock_takes_its_time_and_says_so(forearm):
    forearm.run(300)
    assert get(forearm.master, BUDGET_US) == 0xFFFFFFFF
    assert forearm.reports[-1].flags & (CycleFlags.CUT_SHORT | CycleFlags.LOWERED | CycleFlags.OVERRUN) == 0


def test_level_that_is_compiled_while_the_master_runs_is_used_from_the_next_cycle():
    rig = Rig("pad", level="fit", available="kmeans")
    reports, _, _ = rig.run(1000)
    assert {report.level for report in reports} == {"kmeans"}
    rig.master.allow("fit")
    reports, events, _ = rig.run(500)
    assert {report.level for report in reports} == {"fit"}
    assert [e.detail for e in events if e.kind == "level"] == ["raised to fit: its kernels are compiled"]
