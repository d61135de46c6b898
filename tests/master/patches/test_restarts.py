"""Patches that do not keep running: restarts back off and are counted, and EMCY are few."""

import pytest

from skinbus.config.system import load_arm
from skinbus.master import Master
from skinbus.objects import cia
from tests.master.commission import Bench, patch
from tests.master.misbehaving import Rebooting


@pytest.mark.slow
def test_patch_that_reboots_10_ms_after_each_start_backs_off_and_costs_few_emcys():
    device = Rebooting(patch(1), after_ms=10)
    bench, events = Bench(device), []
    master = Master(load_arm("pad"))
    bench.wire.attach(master, on_event=events.append)
    bench.pass_ms(10_000)
    emcys = [frame for frame in bench.frames if frame.can_id == cia.EMCY_BASE + 127]
    print(f"{device.n_starts} starts, {len(emcys)} EMCY in 10 s")
    assert device.n_starts == 5  # at 0, 0, 1, 3 and 7 s
    assert master.table.restarts[0] == device.n_starts
    assert len(emcys) <= 2 * device.n_starts
    kinds = [event.kind for event in events]
    assert kinds.count("patch-rebooted") == device.n_starts
    assert "restart 5, in 8 s" in [event.detail for event in events]
