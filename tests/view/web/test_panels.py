"""Panels say what is, bad boards first; what strangers wrote is text."""

import re

import numpy as np
import pytest

from skinbus.master.level_control import CycleFlags
from skinbus.master.patches.table import PatchState
from skinbus.skin.pressed import PressedLoads
from skinbus.view.web import panels
from skinbus.view.web.drawing import Drawer
from skinbus.view.web.history import History
from skinbus.view.web.poses import in_a_row
from tests.view.web.cycles import ARM, MadeCycle


def test_boards_that_need_attention_come_first():
    faults = np.zeros(ARM.n_tactels, np.uint8)
    faults[ARM.tactels_of(9)][:2] = 4
    shown = panels.boards(
        MadeCycle(3, states={20: PatchState.SILENT, 4: PatchState.BOOTING}, faults=faults), ARM
    )
    assert "22 of 24 boards operational" in shown
    places = [shown.index(word) for word in ("silent", "booting", "2 frozen")]
    places.append(shown.rindex("operational"))
    assert places == sorted(places)


def test_names_of_strangers_are_text():
    assert "<script>" not in panels.head("<script>alert(1)</script>\x1b[2J", "live", "good")
    assert "\x1b" not in panels.head("\x1b[2J", "live", "good")


def test_state_of_the_source_is_said():
    cycle, drawer = MadeCycle(5), Drawer(ARM, in_a_row(ARM))
    fresh, stale = drawer.draw(cycle), drawer.draw(cycle, age_s=2.0)
    assert panels.state_of(cycle, fresh, False, None) == ("live", "good")
    assert panels.state_of(cycle, stale, False, None)[1] == "lost"
    assert panels.state_of(None, None, False, None)[1] == "waiting"
    cycle.flags = CycleFlags.INCOMPLETE | CycleFlags.LOWERED
    assert panels.state_of(cycle, fresh, False, None) == ("live, boards without readings", "waiting")
    cycle.flags = CycleFlags.LOWERED
    assert panels.state_of(cycle, fresh, False, None) == ("live, impaired", "waiting")
    assert panels.state_of(cycle, stale, True, None) == ("ended", "idle")
    assert "no bus" in panels.state_of(cycle, stale, True, OSError("no bus"))[0]


def test_cycle_says_its_level_its_time_and_how_late_it_is():
    history = History()
    history.take(MadeCycle(1))
    cycle = MadeCycle(1)
    shown = panels.cycle_table(cycle, history, 20.0)
    assert "fit" in shown
    assert "5.0 ms of 20.0 ms" in shown
    assert shown.count("not known from here") == 2  # its buses are not seen, nor its budget
    cycle.bus_loads, cycle.budget_us = (0.614,), 12_340.0
    shown = panels.cycle_table(cycle, history, 20.0)
    assert "61 %" in shown
    assert "12.3 ms" in shown
    cycle.budget_us = np.inf
    assert "no limit" in panels.cycle_table(cycle, history, 20.0)


def test_loads_are_of_the_arm_of_links_and_of_the_boards_that_are_pressed():
    pressures = np.zeros(ARM.n_tactels)
    pressures[ARM.tactels_of(9)] = 10e3
    pressures[ARM.tactels_of(3)] = 5e3
    cycle = MadeCycle(3, pressures=pressures)
    loads = PressedLoads(ARM).of(cycle.readings)
    shown = panels.loads(ARM, cycle, loads)
    assert f"<b>{loads.force:.1f} N</b>" in shown
    assert loads.force == pytest.approx(15e3 * 0.0025, rel=0.2)  # boards of 5 cm, and what is felt of gaps
    assert shown.index(panels.board_name(ARM, 9)) < shown.index(panels.board_name(ARM, 3))
    assert "no readings" not in shown
    labels = Drawer(ARM, in_a_row(ARM)).load_labels(loads)
    assert f"{loads.patches.force[9]:.1f} N" in [label.text for label in labels]


def test_legend_has_its_numbers():
    shown = panels.legend(30.0)
    assert all(f"<span>{tick}</span>" in shown for tick in ("0", "15", "30"))


def test_latencies_beyond_the_period_are_bars_of_another_colour():
    history = History()
    assert 'class="bars"' not in panels.cycle_table(MadeCycle(1), history, 20.0)
    history.take(MadeCycle(1))
    assert 'class="lost"' not in panels.cycle_table(MadeCycle(1), history, 20.0)
    shown = panels.cycle_table(MadeCycle(1), history, 4.0)  # 5 ms in a period of 4 ms
    bars, late = re.findall(r'class="bars">([^<]*)<span class="lost">([^<]*)<', shown)[0]
    assert len(bars + late) == panels.N_BINS
    assert panels.BARS[-1] in late
    assert set(bars) == {panels.BARS[0]}
