"""Two boards under one node-ID: WRONG, EMCY 0x8150, and both are named."""

import pytest

from skinbus.master.patches.table import PatchState
from skinbus.objects import cia
from tests.master.commission import Bench, patch
from tests.master.faults_rig import emcy
from tests.master.misbehaving import Late

NODE = 1


def running(*devices):
    """A master and boards, for half a second."""
    bench = Bench(*devices)
    master = bench.start()
    bench.pass_ms(500)
    return master, bench


def assert_named(master, bench):
    assert master.table.state[0] == PatchState.WRONG
    (doubled,) = [event for event in bench.events if event.kind == "patch-doubled"]
    assert doubled.detail == "2 boards answer under this node-ID: serial numbers 77 and 78"
    assert (cia.EmcyCode.COB_ID_COLLISION, NODE) in emcy(bench.frames)


def test_two_boards_that_are_there_at_the_start_are_named_and_never_started():
    devices = [patch(NODE, serial=serial) for serial in (77, 78)]
    master, bench = running(devices[0], Late(devices[1]))
    assert_named(master, bench)
    assert "patch-started" not in [event.kind for event in bench.events]
    assert all(report.n_fresh == 0 for report in bench.reports)
    assert {device.nmt_state for device in devices} == {cia.NmtState.PRE_OPERATIONAL}


def test_board_that_is_plugged_in_beside_another_is_named_by_its_boot_up():
    master, bench = running(patch(NODE, serial=77))
    assert master.table.state[0] == PatchState.OPERATIONAL
    bench.wire.attach(Late(patch(NODE, serial=78)))
    bench.pass_ms(500)
    assert_named(master, bench)


@pytest.mark.slow
def test_board_that_joins_unseen_is_named_by_its_readings_and_the_other_recovers_when_it_is_gone():
    master, bench = running(patch(NODE, serial=77))
    other = patch(NODE, serial=78)
    Bench(other).pass_ms(130)  # it booted before it came to this bus
    other.command(cia.NmtCommand.START)
    other.set(0x6401, 1, 16)  # the same readings from both would do no harm
    port = bench.wire.attach(Late(other))
    bench.pass_ms(2500)
    assert_named(master, bench)
    bench.wire.detach(port)
    bench.pass_ms(2500)
    assert master.table.state[0] == PatchState.OPERATIONAL
    assert bench.reports[-1].n_fresh == 1
