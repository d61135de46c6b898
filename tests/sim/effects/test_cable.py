"""cable: boards behind a contact that opens are cut off, late, and start again when their supply was gone."""

import numpy as np

from skinbus.sim.effects.cable import Cable

MEDIAN = {"spread": 0.0}


def test_while_it_is_open_boards_behind_say_nothing_and_others_are_as_before(simulate, forearm):
    plain = simulate(n_syncs=60, arm=forearm)
    cut = simulate(
        [Cable(node=20, per_minute=400.0, open_ms=60.0, hold_up_ms=1e3, **MEDIAN)], n_syncs=60, arm=forearm
    )
    before = [[f for f in run.tpdos() if f.can_id & 0x7F < 20] for run in (cut, plain)]
    assert before[0] == before[1]
    assert len(cut.tpdos(22)) < len(plain.tpdos(22))
    assert len(cut.boots()) == len(plain.boots())


def test_what_a_board_was_saying_comes_late(simulate, pad):
    """The frames for the SYNC after which it opened come with those of the SYNC after which it has closed."""
    cut = simulate([Cable(node=1, per_minute=600.0, open_ms=50.0, hold_up_ms=1e3, **MEDIAN)], n_syncs=60)
    per_cycle = np.bincount(
        [round((f.t_ns - 100_000_000) / (1e9 / pad.bus.rate_hz)) for f in cut.tpdos()], minlength=61
    )
    assert 0 in per_cycle[1:60]
    assert per_cycle.max() == 2 * len({f.can_id for f in cut.tpdos()})


def test_boards_start_again_when_the_supply_did_not_last(simulate, pad):
    brief = simulate([Cable(node=1, per_minute=600.0, open_ms=30.0, hold_up_ms=31.0, **MEDIAN)], n_syncs=60)
    long = simulate([Cable(node=1, per_minute=600.0, open_ms=32.0, hold_up_ms=31.0, **MEDIAN)], n_syncs=60)
    assert len(brief.boots()) == pad.n_patches
    assert len(long.boots()) > pad.n_patches
