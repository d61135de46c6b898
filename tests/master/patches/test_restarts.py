"""Patches that do not keep running: restarts back off and are counted, and EMCY are few."""

import pytest

from skinbus.objects import cia
from tests.master.commission import Bench, patch
from tests.master.misbehaving import Rebooting, Wrapped


@pytest.mark.slow
def test_patch_that_reboots_10_ms_after_each_start_backs_off_and_costs_few_emcys():
    device = Rebooting(patch(1), after_ms=10)
    bench = Bench(device)
    master = bench.start()
    bench.pass_ms(10_000)
    emcys = [frame for frame in bench.frames if frame.can_id == cia.EMCY_BASE + 127]
    assert device.n_starts == 5  # at 0, 0, 1, 3 and 7 s
    assert master.table.restarts[0] == device.n_starts
    assert len(emcys) <= 2 * device.n_starts
    kinds = [event.kind for event in bench.events]
    assert kinds.count("patch-rebooted") == device.n_starts
    assert "restart 5, in 8 s" in [event.detail for event in bench.events]


class Stopped(Wrapped):
    """Its heartbeat says STOPPED whatever it is told."""

    def step(self, now_ns, frames):
        step = self.device.step(now_ns, frames)
        out = [f._replace(data=b"\x04") if f.can_id == cia.HEARTBEAT_BASE + 1 else f for f in step.frames]
        return step._replace(frames=[f for f in out if f.can_id != cia.SDO_SERVER_BASE + 1])


@pytest.mark.slow
def test_a_patch_that_stays_stopped_is_reset_more_and_more_rarely():
    bench = Bench(Stopped(patch(1)))
    bench.start()
    bench.pass_ms(12_000)
    resets = [f for f in bench.frames if (f.can_id, f.data) == (cia.NMT_COMMAND_ID, b"\x82\x01")]
    assert 3 <= len(resets) <= 6


class Busy(Wrapped):
    """It takes the start command half a second late, as on a machine that is overloaded."""

    late_ns, start = 500_000_000, None

    def step(self, now_ns, frames):
        for frame in frames:
            if (frame.can_id, frame.data[:1]) == (cia.NMT_COMMAND_ID, b"\x01"):
                self.start = now_ns + self.late_ns, frame
        frames = [f for f in frames if self.start is None or f != self.start[1]]
        if self.start and now_ns >= self.start[0]:
            frames, self.start = [*frames, self.start[1]], None
        step = self.device.step(now_ns, frames)
        return step._replace(wake_ns=min(step.wake_ns, self.start[0])) if self.start else step


def test_a_patch_that_is_started_late_by_half_a_second_is_started_once():
    device = patch(1)
    device.set(cia.HEARTBEAT_PRODUCER, 0, 100)
    bench = Bench(Busy(device))
    master = bench.start(level="kmeans")
    bench.pass_ms(2000)
    assert [event.kind for event in bench.events].count("patch-started") == 1
    assert master.table.restarts[0] == 0
    assert master.table.is_running[0]
