"""Bad zeros and tactels that cannot be right, on the bus: no contact of theirs, and they are named."""

import struct

import numpy as np
import pytest

from skinbus.can.event import EventKind
from skinbus.estimate import Quality, TactelFault
from skinbus.master.level_control import CycleFlags
from skinbus.objects import cia
from skinbus.objects.eds import load_eds
from skinbus.objects.profile import FAULTY, PATCH_FAULTY, PATCH_FAULTY_COUNT, index_of
from tests.master.rig import Rig

MASTER = 127
OD = load_eds("skin-master", MASTER)
MAP, _ = index_of(OD, PATCH_FAULTY)
COUNT, _ = index_of(OD, PATCH_FAULTY_COUNT)
NODE = 1


class Noise:
    """What a patch reads that nothing touches, four tactels at a time: 200 Pa in counts."""

    def __init__(self, seed=4):
        print("seed", seed)
        self.rng = np.random.default_rng(seed)
        self.forced = None
        """Readings (16,) that are sent instead; NaN where there are none."""

    def __call__(self, tpdo, counts):
        counts = counts + np.rint(26.0 * self.rng.standard_normal(4)).astype(int)
        if self.forced is None:
            return counts
        forced = self.forced[4 * tpdo : 4 * tpdo + 4]
        return np.where(np.isnan(forced), counts, np.nan_to_num(forced)).astype(int)

    def force(self, counts, tactels=slice(None)):
        self.forced = np.full(16, np.nan)
        self.forced[tactels] = counts


@pytest.fixture
def noise():
    return Noise()


def make_rig(noise, **settings):
    """A pad of one patch with noise; a finger presses it from 0.5 to 2.5 s of scene time."""
    rig = Rig("pad", **settings)
    rig.patches.changes[NODE] = noise
    return rig


def shown(rig):
    """Bit map and count of the patch, and the count of the arm, as clients read them."""
    device = rig.master.device
    return device.get(MAP, NODE), device.get(COUNT, NODE), device.get(*index_of(OD, FAULTY))


def emcys(frames):
    """Data of the EMCYs of the master about tactels: node-ID, first tactel, faults, count."""
    data = [bytes(frame.data) for frame in frames if frame.can_id == cia.EMCY_BASE + MASTER]
    return [tuple(d[3:7]) for d in data if struct.unpack("<H", d[:2])[0] == cia.EmcyCode.DEVICE_SPECIFIC]


def kinds(events):
    return [event.kind for event in events if "implausible" in event.kind]


@pytest.mark.slow
@pytest.mark.parametrize("counts", [-3000, -32768])
def test_start_below_the_zero_band_makes_no_contact_and_is_over_by_itself(noise, counts):
    rig = make_rig(noise)
    noise.force(counts)
    _, events, frames = rig.run(1500)
    assert shown(rig) == (0xFFFF, 16, 16)
    assert set(kinds(events)) == {EventKind.TACTELS_IMPLAUSIBLE}
    assert emcys(frames)[0][:2] == (NODE, 1)
    rig.run(2000)  # the finger has come and gone
    assert not any(len(report.contacts) for report in rig.reports)
    noise.forced = None
    _, events, frames = rig.run(4000)
    assert shown(rig) == (0, 0, 0)
    assert kinds(events)[-1] == EventKind.TACTELS_IMPLAUSIBLE_END
    forces = [report.contacts.force.sum() for report in rig.reports[-10:]]
    assert max(forces, default=0.0) < 20.0


def test_bytes_frozen_in_a_press_are_no_contact_and_named(noise):
    rig = make_rig(noise)
    noise.force(0.0)
    rig.run(10)
    noise.forced = None
    reports, _, _ = rig.run(2000)
    assert len(reports[-1].contacts) == 1, "the finger presses"
    kept = {}

    def freeze(tpdo, counts):
        return kept.setdefault(tpdo, noise(tpdo, counts))

    rig.patches.changes[NODE] = freeze
    reports, events, frames = rig.run(5000)
    assert 1 <= len(kinds(events)) <= 2, "once, and once more when more of them are found"
    assert emcys(frames)[-1] == (NODE, 1, TactelFault.FROZEN, 16)
    after = [report for report in reports if report.t_ns > reports[0].t_ns + 1_500_000_000]
    assert not any(len(report.contacts) for report in after)
    assert all(report.flags & CycleFlags.IMPAIRED for report in after)
    assert all(np.isfinite(report.pressures).all() for report in reports)


def test_tactel_at_full_scale_is_no_contact_and_those_beside_it_say_so(noise):
    rig = make_rig(noise)
    rig.run(600)
    noise.force(32752, [0])
    reports, _, frames = rig.run(1500)
    assert emcys(frames) == [(NODE, 1, TactelFault.RAIL, 1)]
    assert shown(rig) == (1, 1, 1)
    late = [report.contacts for report in reports[-25:]]
    assert [len(contacts) for contacts in late] == [1] * 25, "the finger alone"
    contacts, arm = late[-1], rig.scene.arm
    to_contact = np.hypot(arm.tactel_s - contacts.s[0], arm.tactel_a - contacts.a[0])
    to_faulty = np.hypot(arm.tactel_s - arm.tactel_s[0], arm.tactel_a - arm.tactel_a[0])
    feel_it = rig.master.cycle.baseline.touched & (to_contact < 0.015)
    is_near = to_contact[0] < 0.015 or (feel_it & (to_faulty < 0.015)).any()
    assert bool(contacts.quality[0] & Quality.IMPAIRED) == bool(is_near)


def test_healthy_patch_reports_nothing(noise):
    rig = make_rig(noise)
    _, events, frames = rig.run(6000)
    assert shown(rig) == (0, 0, 0)
    assert not kinds(events)
    assert not emcys(frames)


@pytest.mark.slow
def test_patch_that_answers_some_syncs_with_old_readings_is_not_fresh_then_and_reported_within_a_second(
    noise,
):
    rig = make_rig(noise)
    rig.run(1500)
    old, repeats = {}, []

    def repeat(tpdo, counts):
        if tpdo == 0:
            repeats.append(bool(old) and noise.rng.random() < 0.3)
        if not repeats[-1]:
            old[tpdo] = noise(tpdo, counts)
        return old[tpdo]

    rig.patches.changes[NODE] = repeat
    reports, events, _ = rig.run(1000)
    repeated = [event.kind for event in events if "repeated" in event.kind]
    assert repeated == [EventKind.READINGS_REPEATED]
    first = repeats[-len(reports) :]
    assert [not report.fresh[0] for report in reports] == first
    assert sum(first) > 5
    rig.patches.changes[NODE] = noise
    reports, events, _ = rig.run(7000)
    repeated = [event.kind for event in events if "repeated" in event.kind]
    assert repeated == [EventKind.READINGS_REPEATED_END]
    assert all(report.fresh[0] for report in reports[2:])


@pytest.mark.slow
def test_patches_that_send_the_same_readings_are_not_fresh_and_both_reported_within_a_second(noise):
    rig = Rig("forearm")
    others = {node: Noise(node) for node in range(1, 25)}
    rig.patches.changes.update(others)
    rig.run(1500)
    sent = {}

    def original(tpdo, counts):
        sent[tpdo] = others[3](tpdo, 0 * counts)
        return sent[tpdo]

    rig.patches.changes[3] = original
    rig.patches.changes[4] = lambda tpdo, counts: sent[tpdo]
    reports, events, _ = rig.run(1000)
    copied = [event.node_id for event in events if event.kind == EventKind.READINGS_COPIED]
    assert sorted(copied) == [3, 4]
    assert not kinds(events)
    for report in reports[2:]:
        assert np.flatnonzero(~report.fresh).tolist() == [2, 3]
