"""bus_off: boards off the bus, running on, and an EMCY when they are back."""

from skinbus.sim.effects.bus_off import BusOff


def test_board_off_the_bus_misses_its_cycles_and_reports_its_return(simulate, forearm):
    run = simulate([BusOff(nodes=(4,), at_s=0.1, recovery_s=0.19)], n_syncs=30, arm=forearm)
    assert len(run.tpdos(4)) == 4 * (30 - 10)
    assert len(run.boots()) == 24, "it does not boot: it never stopped"
    emcy = [f for f in run.frames if f.can_id == 0x084]
    assert [f.data[:2] for f in emcy] == [b"\x40\x81"]
    assert len(emcy[0].data) == 8


def test_node_that_the_arm_does_not_have_is_a_fault(pad):
    assert len(BusOff(nodes=(4,)).check(pad)) == 1
