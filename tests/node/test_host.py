"""The patches of one bus and their source: what is read is sent, and what means nothing is not."""

import numpy as np
import pytest

from skinbus.can.frame import Frame
from skinbus.node import Device, PatchHost, Sample
from skinbus.objects.eds import load_eds
from skinbus.objects.guard import GFC_ID, GuardLimits

MS = 1_000_000
PERIOD_MS = 20
STOPPED, PART, GONE = "00 50 01 73 74 6F 70 00", "00 50 01 70 61 72 74 00", "00 00 00 00 50"


class Rig:
    """Three patches of 16 tactels that are OPERATIONAL, and what they say to each SYNC."""

    def __init__(self, eds="skin-patch"):
        self.counts, self.healthy = np.zeros((3, 16), np.int32), np.ones((3, 16), np.bool_)
        self.n_asked, self.age_ns = 0, 0
        self.host = PatchHost([Device(load_eds(eds, n), n) for n in (1, 2, 3)], self.newest)
        self.now_ns = 0
        self.host.step(0)
        self.hear(Frame(0x000, b"\x01\x00"))

    def newest(self, now_ns):
        self.n_asked += 1
        return Sample(self.counts.ravel(), now_ns - np.full(3, self.age_ns), self.healthy.ravel())

    def hear(self, frame):
        return self.host.step(self.now_ns, [frame]).frames

    def sync(self):
        """Return what each node says, readings as (n,) counts and EMCY as text, by node-ID."""
        self.now_ns += PERIOD_MS * MS
        said = {1: [], 2: [], 3: []}
        errors = {1: [], 2: [], 3: []}
        for frame in self.hear(Frame(0x080)):
            node_id = frame.can_id & 0x7F
            if frame.can_id < 0x100:
                errors[node_id].append(frame.data.hex(" ").upper())
            else:
                said[node_id] += np.frombuffer(frame.data, "<i2").tolist()
        return said, errors

    def pass_ms(self, ms):
        for _ in range(ms):
            self.now_ns += MS
            self.host.step(self.now_ns)

    def guard(self, *patches):
        """Give patches limits of 1000 counts for each tactel."""
        limits = GuardLimits(1, 1, 2**31 - 1, np.full(16, 1000), *np.zeros((2, 16), int))
        for i in patches:
            self.host.devices[i].set(0x2081, 0, limits.encode())
            self.host.wake(i, self.now_ns)

    def states(self):
        return [device.get(0x2080, 1) for device in self.host.devices]

    def set(self, patch, tactels, healthy):
        self.healthy = self.healthy.copy()
        self.healthy[patch, tactels] = healthy


@pytest.fixture
def rig():
    return Rig()


def test_each_patch_sends_its_own_readings_of_the_newest_sample(rig):
    for _ in range(3):
        rig.counts = np.random.default_rng(rig.n_asked).integers(-0x8000, 0x8000, (3, 16)).astype(np.int32)
        said, errors = rig.sync()
        assert [said[n] for n in (1, 2, 3)] == rig.counts.tolist()
        assert not any(errors.values())


def test_tactel_without_a_reading_is_at_a_rail_and_said_until_it_has_one(rig):
    rig.counts = rig.counts + 100
    rig.sync()
    rig.set(1, [3, 15], False)
    said, errors = rig.sync()
    assert said[2] == [-0x8000 if k in (3, 15) else 100 for k in range(16)]
    assert said[1] == said[3] == [100] * 16
    assert errors == {1: [], 2: [PART], 3: []}
    assert rig.host.devices[1].get(0x2040) == 0x7FF7
    assert not any(rig.sync()[1].values()), "it is said once"
    rig.set(1, 3, True)
    said, errors = rig.sync()
    assert said[2] == [100] * 15 + [-0x8000]
    rig.set(1, 15, True)
    said, errors = rig.sync()
    assert said[2] == [100] * 16
    assert errors[2][0].startswith(GONE)
    assert rig.host.devices[1].get(0x2040) == 0xFFFF


def test_patch_whose_source_has_stopped_sends_no_readings_and_others_do(rig):
    rig.counts = rig.counts + 7
    rig.sync()
    rig.set(0, slice(None), False)
    said, errors = rig.sync()
    assert (said[1], said[2], said[3]) == ([], [7] * 16, [7] * 16)
    assert errors[1] == [STOPPED]
    assert rig.sync()[0][1] == []
    rig.set(0, slice(None), True)
    said, errors = rig.sync()
    assert said[1] == [7] * 16
    assert errors[1][0].startswith(GONE)


def test_where_the_status_of_samples_is_mapped_a_stopped_source_is_marked():
    rig = Rig("skin-patch-fd")
    rig.sync()
    rig.set(0, slice(None), False)
    said, errors = rig.sync()
    assert errors[1] == [STOPPED]
    marks = [frame.data[33] for frame in rig.hear(Frame(0x080)) if len(frame.data) > 32]
    assert marks == [0x05, 0, 0], "older than the SYNC, and an error is there"
    assert set(said[1][:16]) == {-0x8000}


@pytest.mark.parametrize(("age_us", "mapped"), [(0, 0), (250, 2), (43_219, 432), (7e6, 0xFFFF), (-9e3, 0)])
def test_age_of_a_sample_is_that_at_its_sync_and_saturates(age_us, mapped):
    rig = Rig("skin-patch-fd")
    rig.age_ns = int(1e3 * age_us)
    rig.now_ns += PERIOD_MS * MS
    frames = rig.hear(Frame(0x080))
    assert [int.from_bytes(frame.data[34:36], "little") for frame in frames] == [mapped] * 3
    assert {frame.data[33] for frame in frames} == {0}, "not of a source that has stopped"


def test_patch_that_starts_while_its_source_stands_still_says_so_after_its_boot(rig):
    rig.set(2, slice(None), False)
    rig.sync()
    said = rig.hear(Frame(0x000, b"\x81\x03"))
    assert [(frame.can_id, frame.data.hex(" ").upper()) for frame in said] == [
        (0x703, "00"),
        (0x083, STOPPED),
    ]
    assert rig.host.devices[2].get(0x2040) == 0
    rig.hear(Frame(0x000, b"\x01\x00"))
    assert rig.sync()[0][3] == []


def test_bits_that_the_master_clears_stay_cleared_when_tactels_come_back(rig):
    rig.sync()
    rig.host.devices[0].set(0x2040, 0, 0xFFFE)
    rig.set(0, [0, 1], False)
    rig.sync()
    assert rig.host.devices[0].get(0x2040) == 0xFFFC
    rig.set(0, [0, 1], True)
    rig.sync()
    assert rig.host.devices[0].get(0x2040) == 0xFFFE


def test_source_is_asked_between_syncs_only_while_a_patch_guards(rig):
    rig.host.devices[0].set(0x1808, 1, 0x40000501)  # its state is on no SYNC, but no reading
    before = rig.n_asked
    rig.pass_ms(10)
    assert rig.n_asked == before
    rig.guard(1)
    rig.pass_ms(10)
    assert rig.n_asked >= before + 9
    assert rig.states() == [0, 1, 0]
    rig.hear(Frame(0x000, b"\x80\x02"))
    before = rig.n_asked
    rig.pass_ms(10)
    assert rig.n_asked == before


def test_patches_that_trip_together_send_one_command_before_all_else(rig):
    rig.guard(0, 1, 2)
    rig.pass_ms(3)
    rig.counts = np.full((3, 16), 1001, np.int32)
    rig.now_ns += MS
    ids = [frame.can_id for frame in rig.hear(Frame(0x080))]
    assert ids[0] == GFC_ID
    assert ids.count(GFC_ID) == 1
    assert {0x081, 0x082, 0x083, 0x181, 0x483} <= set(ids)
    assert rig.states() == [3, 3, 3]


def test_patch_without_a_source_is_not_armed(rig):
    rig.guard(0, 1)
    rig.pass_ms(3)
    rig.set(0, slice(None), False)
    rig.set(1, 3, False)
    rig.pass_ms(1)
    assert rig.states() == [0, 0, 0]


def test_patch_that_begins_to_guard_puts_off_no_sample_of_the_others(rig):
    rig.guard(0)
    rig.pass_ms(2)
    asked = [rig.n_asked]
    for k in range(20):
        rig.guard(1)
        rig.pass_ms(1)
        if k % 2:
            rig.hear(Frame(0x000, b"\x80\x02"))
            rig.hear(Frame(0x000, b"\x01\x02"))
        asked.append(rig.n_asked)
    assert min(np.diff(asked)) >= 1
