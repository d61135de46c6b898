"""Panels say what is, bad boards first; what strangers wrote is text."""

from types import SimpleNamespace

import numpy as np
import pytest

from skinbus.skin.cycle import CycleFlags, PatchState
from skinbus.skin.pressed import PressedLoads
from skinbus.view.web import panels
from tests.view.web.cycles import ARM, made_cycle


def source(**changes):
    usual = {
        "error": None,
        "has_ended": False,
        "pace": 1.0,
        "gone": "gone",
        "n_cycles": 7,
        "n_lost": 0,
    }
    return SimpleNamespace(**usual | changes)


def test_boards_that_need_attention_come_first_with_their_loads():
    faults, pressures = np.zeros(ARM.n_tactels, np.uint8), np.zeros(ARM.n_tactels)
    faults[ARM.tactels_of(9)][:2] = 4
    pressures[ARM.tactels_of(3)] = 10e3
    states = {20: PatchState.SILENT, 4: PatchState.BOOTING}
    cycle = made_cycle(3, states=states, faults=faults, pressures=pressures)
    loads = PressedLoads(ARM).of(cycle.readings)
    shown = panels.boards(cycle, ARM, loads)
    assert "22 of 24 boards operational" in shown
    places = [shown.index(word) for word in ("silent", "booting", "2 frozen")]
    places.append(shown.rindex("operational"))
    assert places == sorted(places)
    assert f"load {loads.force:.1f} N: forearm {loads.force:.1f} N" in shown
    assert f">{loads.patches.force[3]:.1f}<" in shown


def test_names_of_strangers_are_text():
    shown = panels.head("<script>a</script>\x1b[2J", source(), None, is_stale=False, n_drawn=0, notes=["<b>"])
    assert "<script>" not in shown
    assert "\x1b" not in shown
    assert "<b></div>" not in shown


@pytest.mark.parametrize(
    ("changes", "flags", "is_stale", "said"),
    [
        ({}, 0, False, ("live", "good")),
        ({}, 0, True, ("gone", "lost")),
        ({}, CycleFlags.INCOMPLETE | CycleFlags.LOWERED, False, ("live, boards without readings", "waiting")),
        ({}, CycleFlags.LOWERED, False, ("live, impaired", "waiting")),
        ({"pace": 0.42}, 0, False, ("slow: 0.42 of real time", "waiting")),
        ({"has_ended": True}, 0, True, ("ended", "idle")),
        ({"has_ended": True, "error": OSError("no bus")}, 0, True, ("ended: no bus", "lost")),
    ],
)
def test_state_of_the_source_is_said(changes, flags, is_stale, said):
    cycle = made_cycle(5, flags=CycleFlags(flags))
    assert panels.state_of(source(**changes), cycle, is_stale=is_stale) == said
    assert panels.state_of(source(), None, is_stale=False)[1] == "waiting"
