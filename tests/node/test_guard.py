"""The guard of a patch: it trips when a plain comparison does, and many are one frame on a loaded bus."""

import numpy as np
import pytest

from skinbus.can.core import Core, Step
from skinbus.can.frame import Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.node import Device, PatchHost, Sample
from skinbus.objects.cia import EmcyCode
from skinbus.objects.eds import load_eds
from skinbus.objects.guard import GFC_ID, NO_LIMIT, GuardLimits, GuardState

MS = 1_000_000
N = 16
LIMITS, STATE, TRIPPED_BY, ACKNOWLEDGE = (0x2081, 0), (0x2080, 1), (0x2080, 2), "23 80 20 03 61 63 6B 6E"
START = Frame(0x000, b"\x01\x00")


def guarding(limits, eds="skin-patch"):
    """Return a device that is OPERATIONAL and has limits."""
    device = Device(load_eds(eds, 5), 5)
    device.step(0)
    device.step(0, [START])
    device.set(*LIMITS, limits.encode())
    return device


def plain(n, m, sum_limit, limits, weights, samples):
    """Yield for each sample the tactel (0: the sum) and the value that trips a guard, None if it does not.

    A sample is counts, or None: the guard was acknowledged.
    """
    last, is_tripped = [], False
    for counts in samples:
        if counts is None:
            last, is_tripped = ([], False) if is_tripped else (last, False)
            yield None
            continue
        over = [k for k in range(len(counts)) if counts[k] > limits[k]]
        total = sum(w * c for w, c in zip(weights, counts, strict=True))
        last = [*last, bool(over) or total > sum_limit][-m:]
        trips = last[-1] and sum(last) >= n and not is_tripped
        is_tripped |= trips
        yield (over[0] + 1, counts[over[0]]) if trips and over else (0, total) if trips else None


@pytest.mark.parametrize(
    ("eds", "index", "counts"),
    [
        ("skin-patch", 0x6401, [-0x8000, 99, 100, 101, 300, 0x7FFF]),
        ("skin-patch-8bit", 0x6400, [-0x80, 0, 40, 41, 42, 0x7F]),
    ],
)
def test_it_trips_on_the_samples_on_which_a_plain_comparison_does(eds, index, counts):
    rng = np.random.default_rng(40)
    n_trips = 0
    for _ in range(60):
        m = int(rng.integers(1, 9))
        n = int(rng.integers(1, m + 1))
        limits = np.where(rng.random(N) < 0.1, rng.choice(counts, N), NO_LIMIT)
        weights = rng.choice([0, 0, 1, 1023], N)
        sum_limit = int(rng.choice([-1, 0, 300, 100_000, 2**31 - 1]))
        samples = [rng.choice(counts, N) * (rng.random(N) < 0.2) for _ in range(30)]
        samples = [None if rng.random() < 0.1 else sample.tolist() for sample in samples]
        device = guarding(GuardLimits(n, m, sum_limit, limits, weights), eds)
        readings = device.image_view(index, 1, N)
        wanted = plain(n, m, sum_limit, limits.tolist(), weights.tolist(), samples)
        for k, (sample, trip) in enumerate(zip(samples, wanted, strict=True), 1):
            if sample is None:
                device.step(k * MS, [Frame(0x605, bytes.fromhex(ACKNOWLEDGE))])
                assert not device.get(*STATE) & GuardState.TRIPPED
                continue
            readings[:] = sample
            device.sampled(0)
            sent = [(f.can_id, f.data) for f in device.step(k * MS, [Frame(0x080)]).frames]
            told = []
            if trip:
                emcy = EmcyCode.GUARD_TRIPPED.to_bytes(2, "little") + b"\x81"
                told = [(0x085, emcy + bytes([trip[0]]) + trip[1].to_bytes(4, "little", signed=True))]
                assert sent.pop(0) == (GFC_ID, b"")
                assert (device.get(*STATE), device.get(*TRIPPED_BY)) == (3, trip[0])
                n_trips += 1
            assert [frame for frame in sent if frame[0] < 0x100] == told
    assert n_trips > 60


class Syncs(Core):
    """A producer of SYNC that starts all patches."""

    def __init__(self, period_ns):
        self.period_ns, self.next_ns = period_ns, 0

    cob_ids = frozenset()

    def step(self, now_ns, frames=()):
        first = [START] if not self.next_ns else []
        if now_ns >= self.next_ns:
            self.next_ns += self.period_ns
            return Step([*first, Frame(0x080)], [], self.next_ns)
        return Step([], [], self.next_ns)


class Skin:
    """24 patches of 16 bits, each with a wire of its own to a bus of 1 Mbit/s at a load of 0.84."""

    def __init__(self, phases_ns):
        self.counts = np.zeros(N, np.int32)
        self.frames = []
        self.bus = VirtualBus()
        self.bus.tap(self.frames.append)
        self.devices = []
        for node_id in range(1, 25):
            device = Device(load_eds("skin-patch", node_id), node_id)
            self.devices.append(device)
            self.bus.attach(PatchHost([device], self.newest))
        self.bus.attach(Syncs(round(1e9 / 70)))
        self.bus.run(30 * MS)
        limits = GuardLimits(1, 1, 2**31 - 1, np.full(N, 1000), np.zeros(N, int))
        for device, port, phase_ns in zip(self.devices, self.bus.ports, phases_ns, strict=False):
            self.bus.run(30 * MS + phase_ns)
            device.set(*LIMITS, limits.encode())
            self.bus.wake(port)
        self.bus.run(60 * MS)

    def newest(self, now_ns):
        return Sample(self.counts, np.array([now_ns]), np.ones(N, bool))

    def cross(self, t_ns):
        """Press all patches at once; return the frames that end later, with the time since then."""
        self.bus.run(t_ns)
        assert all(device.get(*STATE) == 1 for device in self.devices)
        self.frames.clear()
        self.counts = np.where(np.arange(N) == 6, 1001, 0).astype(np.int32)
        self.bus.run(t_ns + 15 * MS)
        return [(frame, frame.t_ns - t_ns) for frame in self.frames]


def test_24_patches_that_cross_at_once_on_a_loaded_bus_are_one_frame_and_say_who_after_it():
    skin = Skin([0] * 24)
    sent = skin.cross(101 * MS + 250_000)
    stops = [ns for frame, ns in sent if frame.can_id == GFC_ID]
    assert len(stops) == 1
    assert stops[0] < 1.3 * MS
    errors = {frame.can_id - 0x080: (frame.data, ns) for frame, ns in sent if 0x080 < frame.can_id < 0x100}
    assert errors.keys() == set(range(1, 25))
    assert {data for data, _ in errors.values()} == {bytes.fromhex("02 FF 81 07 E9 03 00 00")}
    assert all(stops[0] < ns < 5 * MS for _, ns in errors.values())


@pytest.mark.slow
def test_first_frame_of_24_patches_that_sample_at_any_time_is_within_the_bound():
    rng = np.random.default_rng(3)
    worst_ns = 0
    for _ in range(8):
        skin = Skin(np.sort(rng.integers(0, 2 * MS, 24)))
        sent = skin.cross(int(rng.integers(100 * MS, 140 * MS)))
        worst_ns = max(worst_ns, next(ns for frame, ns in sent if frame.can_id == GFC_ID))
    # each patch samples once in 1 ms; the longest frame (135 us) and GFC itself
    assert worst_ns < MS + 135_000 + 55_000


class Patches:
    """Three hosted patches on SYNC every 20 ms; how often their source is asked."""

    def __init__(self, eds="skin-patch"):
        self.n_asked, self.t_ns, self.now_ns = 0, None, 0
        self.counts, self.healthy = np.zeros(3 * N, np.int32), np.ones(3 * N, bool)
        self.devices = [Device(load_eds(eds, n), n) for n in (1, 2, 3)]
        for device in self.devices:
            device.set(0x1017, 0, 0)
            device.set(0x1808, 1, 0x40000500 + device.node_id)
        self.host = PatchHost(self.devices, self.newest)
        self.pass_ms(0)
        self.say(START)

    def newest(self, now_ns):
        self.n_asked += 1
        t_ns = now_ns if self.t_ns is None else self.t_ns
        return Sample(self.counts, np.full(3, t_ns), self.healthy)

    def say(self, frame):
        return self.host.step(self.now_ns, [frame]).frames

    def pass_ms(self, ms):
        """Let time pass; return the frames that are sent."""
        end_ns, sent = self.now_ns + ms * MS, []
        while True:
            step = self.host.step(self.now_ns)
            sent += step.frames
            if step.wake_ns > end_ns:
                break
            self.now_ns = max(self.now_ns, step.wake_ns)
        self.now_ns = end_ns
        return sent

    def limit(self, i):
        limits = GuardLimits(1, 1, 2**31 - 1, np.full(N, 1000), np.zeros(N, int))
        self.devices[i].set(*LIMITS, limits.encode())
        self.host.wake(i, self.now_ns)
        self.host.step(self.now_ns)


@pytest.fixture
def patches():
    return Patches()


def test_source_is_asked_at_each_sync_alone_while_no_patch_guards(patches):
    patches.devices[0].set(0x1808, 5, 20)
    before = patches.n_asked
    for _ in range(5):
        patches.pass_ms(20)
        patches.say(Frame(0x080))
    assert patches.n_asked == before + 5


def test_patch_that_guards_is_told_of_each_sample_and_others_are_not(patches):
    patches.limit(1)
    before = patches.n_asked
    patches.pass_ms(10)
    assert patches.n_asked == before + 10
    assert [device.get(*STATE) for device in patches.devices] == [0, 1, 0]
    patches.counts = np.full(3 * N, 2000, np.int32)
    assert [frame.can_id for frame in patches.pass_ms(2)] == [GFC_ID, 0x082, 0x502]


def test_many_patches_of_a_host_send_one_command_before_all_else(patches):
    for i in range(3):
        patches.limit(i)
    patches.pass_ms(5)
    patches.counts = np.full(3 * N, 2000, np.int32)
    ids = [frame.can_id for frame in patches.say(Frame(0x080))]
    assert GFC_ID not in ids, "a SYNC does not sample for the guard"
    patches.now_ns += MS
    ids = [frame.can_id for frame in patches.say(Frame(0x080))]
    assert ids[0] == GFC_ID
    assert ids.count(GFC_ID) == 1
    assert {0x081, 0x082, 0x083, 0x183, 0x501} <= set(ids)


def test_it_is_not_armed_while_its_source_stands_still_or_has_stopped(patches):
    patches.limit(0)
    patches.pass_ms(5)
    patches.t_ns = patches.now_ns
    patches.pass_ms(3)
    assert patches.devices[0].get(*STATE) == 1
    patches.pass_ms(1)
    assert patches.devices[0].get(*STATE) == 0
    patches.t_ns = None
    patches.pass_ms(1)
    assert patches.devices[0].get(*STATE) == 1
    patches.healthy = np.arange(3 * N) >= N
    sent = patches.pass_ms(1)
    assert patches.devices[0].get(*STATE) == 0
    assert (0x501, b"\0\0") in [(frame.can_id, frame.data) for frame in sent]


def test_limits_of_one_that_others_reset_leave_the_scan_of_the_others_alone(patches):
    """Another patch that begins or ends to guard does not put off the next sample."""
    patches.limit(0)
    asked = [patches.n_asked]
    for k in range(40):
        patches.limit(1)
        patches.pass_ms(1)
        if k % 2:
            patches.say(Frame(0x000, b"\x82\x02"))
            patches.say(Frame(0x000, b"\x01\x02"))
        asked.append(patches.n_asked)
    assert (np.diff(asked) >= 1).all()
