"""From a press, or a fault, to the drive on the bit-exact bus: patch, master, guard and drive are cores."""

import numpy as np
import pytest

from skinbus.can.core import Core, Step
from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.config.arm_file import find_arm
from skinbus.config.system import load_arm, ods_of
from skinbus.guard.stops import parse_stop
from skinbus.guard.watch import Guard
from skinbus.node import Device, PatchHost, Sample, SdoClient
from skinbus.objects.guard import GuardLimits
from tests.guard.rig import ARMED, GFC, MS, QUICK_STOP

GUARD = '[guard]\nliveness_ms = 20\n[[guard.region]]\nname = "pad"\nforce_n = 5.0\nsource = "a test"\n'
US = 1000


class Master(Core):
    """Has the patch say its state every 20 ms, writes limits of 10000 counts, starts it, and lives."""

    cob_ids = frozenset({0x581})

    def __init__(self):
        self.client, self.beats_ns = SdoClient(1), 0
        limits = GuardLimits(1, 1, 2**31 - 1, np.full(16, 10_000), np.zeros(16, np.int64)).encode()
        self.writes = [(0x2081, 0, limits), (0x1808, 5, b"\x14\x00"), (0x1808, 1, b"\x01\x05\x00\x40")]

    def step(self, now_ns, frames):
        out = self.client.step(now_ns, frames)
        if not self.client.busy and self.writes:
            self.client.start_write(*self.writes.pop())
            out += self.client.step(now_ns)
        elif self.client.result:
            assert not self.client.result.unwrap()
            self.client.result = None
            out.append(Frame(0x000, b"\x01\x00"))
        if now_ns >= self.beats_ns:
            self.beats_ns = now_ns + 500 * MS
            out.append(Frame(0x77F, b"\x05"))
        return Step(out, [], min(self.beats_ns, self.client.wake_ns))


class Drive(Core):
    """Node 100: confirms what it is told."""

    cob_ids = frozenset({QUICK_STOP[0]})

    def step(self, now_ns, frames):
        return Step([Frame(0x5E4, bytes.fromhex("6040600000000000")) for _ in frames], [], now_ns + 10**12)


class Loop:
    """Everybody on one bus, until the guard guards."""

    def __init__(self, tmp_path, seed=0):
        file = tmp_path / "pad.toml"
        file.write_text(find_arm("pad").read_text() + GUARD)
        self.arm = load_arm(file)
        self.counts, self.heard, self.kinds = np.zeros(16, np.int32), [], []
        (od,) = ods_of(self.arm)
        self.guard = Guard(self.arm, self.arm.guard, [od], [parse_stop("cia402:100", self.arm)])
        host = PatchHost([Device(od, 1, storage={})], self.newest)
        self.bus = VirtualBus()
        self.ports = [
            self.bus.attach(core, on_event=lambda event: self.kinds.append(event.kind))
            for core in (host, Master(), self.guard, Drive())
        ]
        self.bus.tap(self.heard.append)
        self.run(2000 * MS + int(np.random.default_rng(seed).integers(0, 20 * MS)))
        assert EventKind.GUARDING in self.kinds
        assert EventKind.GUARD_STOP not in self.kinds

    def newest(self, now_ns):
        return Sample(self.counts, np.array([now_ns]), np.ones(16, np.bool_))

    def run(self, for_ns):
        self.bus.run(self.bus.now_ns + for_ns)

    def last(self, can_id, data=b""):
        """When the last such frame ended."""
        return max(frame.t_ns for frame in self.heard if frame[:2] == (can_id, data))

    def told_ns(self):
        """When the drive was first told to stop; it is told in every second from then on, and confirms."""
        told = [frame.t_ns for frame in self.heard if frame[:2] == QUICK_STOP]
        assert EventKind.CONFIRMED in self.kinds
        return told[0]


@pytest.mark.parametrize("seed", range(8))
def test_a_press_stops_the_drive_within_a_sample_and_a_few_frames(tmp_path, seed):
    loop = Loop(tmp_path, seed)
    pressed_ns, loop.counts = loop.bus.now_ns, np.where(np.arange(16) == 4, 20_000, 0).astype(np.int32)
    loop.run(3000 * MS)
    gfc_ns = loop.last(GFC)
    assert pressed_ns < gfc_ns < pressed_ns + 1000 * US + 2 * 135 * US
    assert gfc_ns < loop.told_ns() < gfc_ns + 3 * 135 * US  # EMCY and the state of the patch go first
    assert loop.guard.reason == "GFC"
    assert EventKind.GUARD_TRIPPED in loop.kinds


def test_a_patch_without_power_stops_the_drive_two_and_a_half_periods_after_its_last_sign(tmp_path):
    for seed in range(3):
        loop = Loop(tmp_path, seed)
        loop.bus.detach(loop.ports[0])
        loop.run(200 * MS)
        silent_ns = loop.told_ns() - loop.last(0x501, bytes([ARMED, 0]))
        assert 50 * MS < silent_ns < 50 * MS + 135 * US


def test_a_patch_that_is_reset_or_left_pre_operational_stops_the_drive(tmp_path):
    for command in (0x81, 0x82, 0x80, 0x02):
        loop = Loop(tmp_path)
        loop.bus.submit(loop.ports[3], loop.bus.now_ns, [Frame(0x000, bytes([command, 1]))])
        loop.run(200 * MS)
        assert loop.told_ns() - loop.last(0x501, bytes([ARMED, 0])) < 51 * MS
