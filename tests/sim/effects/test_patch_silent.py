"""patch_silent: boards go, and come back booting."""

from skinbus.sim.effects.patch_silent import PatchSilent


def test_silent_board_says_nothing_between_its_times_and_then_boots(simulate, forearm):
    run = simulate([PatchSilent(nodes=(2, 9), from_s=0.2, to_s=0.4)], n_syncs=30, arm=forearm)
    for node_id in (2, 9):
        assert len(run.tpdos(node_id)) == 4 * (10 + 9), "down for 10 cycles, one more to be started again"
    assert len(run.tpdos(3)) == 4 * 30
    assert [f.can_id - 0x700 for f in run.boots()[24:]] == [2, 9]


def test_silent_board_does_not_hear_either(simulate, forearm):
    run = simulate([PatchSilent(nodes=(2,), from_s=0.0)], n_syncs=5, arm=forearm)
    assert not run.tpdos(2)
    assert not [f for f in run.boots() if f.can_id == 0x702]


def test_return_before_the_loss_is_a_fault(pad):
    assert len(PatchSilent(nodes=(1,), from_s=2.0, to_s=1.0).check(pad)) == 1
    assert len(PatchSilent(nodes=(4,)).check(pad)) == 1
