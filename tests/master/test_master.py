"""The master on the in-process wire: cycles, contacts on the bus, and patches that come and go."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.config.arm_file import find_arm
from skinbus.master.level_control import with_level
from skinbus.master.patches.table import PatchState
from skinbus.objects import cia
from skinbus.objects.contacts import ContactState, unpack_contacts
from skinbus.sim.scene_file import SCENES
from tests.master.rig import Rig

CONTACT_IDS = range(0x681, 0x691)
SUMMARY_ID = 0x180 + 127


def kinds(events, node_id):
    return [event.kind for event in events if event.node_id == node_id and event.kind != EventKind.NMT_STATE]


def test_all_patches_are_started_and_fresh_in_every_cycle(forearm):
    forearm.run(200)
    cycles, _, _ = forearm.run(1000)
    assert len(cycles) == 50
    assert {cycle.n_fresh for cycle in cycles} == {24}
    assert [forearm.state(node_id) for node_id in (1, 24, 25)] == [
        PatchState.OPERATIONAL,
        PatchState.OPERATIONAL,
        PatchState.UNUSED,
    ]


def test_sync_has_no_counter_and_cycles_are_counted_by_the_master(rig):
    reports, _, frames = rig.run(6000)
    assert {f.data for f in frames if f.can_id == cia.SYNC_ID} == {b""}
    assert [report.counter for report in reports][:241] == [*range(1, 241), 1]


def test_sync_carries_the_counter_that_the_arm_file_asks_for(tmp_path):
    """Every patch is told of it as well: none complains, and all send."""
    arm = find_arm("pad").read_text().replace("rate_hz", "sync_counter = 100\nrate_hz", 1)
    (tmp_path / "arm.toml").write_text(arm)
    scene = (SCENES / "pad.toml").read_text().replace('arm = "pad"', 'arm = "arm.toml"', 1)
    (tmp_path / "scene.toml").write_text(scene)
    rig = Rig(tmp_path / "scene.toml")
    reports, _, frames = rig.run(2000)
    counters = [f.data[0] for f in frames if f.can_id == cia.SYNC_ID]
    # patches boot without it: what they say of the first SYNCs is taken back when they are configured
    assert counters[:101] == [*range(1, 101), 1]
    assert reports[-1].n_fresh == 1
    emcys = [f.data[:2] for f in frames if f.can_id == cia.EMCY_BASE + 1]
    assert emcys[-1:] in ([], [b"\0\0"])
    (patch,) = rig.world.devices
    assert patch.get(cia.SYNC_COUNTER_OVERFLOW) == 100


def four_fingers_on_one_patch(folder):
    """A scene; random starts of four clusters often share a finger."""
    touches = "".join(
        f'[[touch]]\nlink = "plate"\nshape = "disc"\ndiameter_mm = 8.0\ns_mm = {s}\na_mm = {a}\n'
        "force_n = [[0.5, 0.0], [0.6, 4.0], [9.0, 4.0]]\n"
        for s, a in ((10.0, -14.0), (10.0, 14.0), (40.0, -14.0), (40.0, 14.0))
    )
    scene = f'[scene]\ntitle = "four fingers"\narm = "pad"\nduration_s = 10.0\n{touches}'
    (folder / "scene.toml").write_text(scene)
    return folder / "scene.toml"


@pytest.mark.slow
def test_clusters_start_at_random_tactels_where_that_is_asked_for(tmp_path):
    scene, forces = four_fingers_on_one_patch(tmp_path), []
    for start in ("maxima", "random", "random"):
        reports, _, _ = Rig(scene, level="kmeans", start=start).run(1500)
        forces.append([contact.force for report in reports for contact in report.contacts])
    assert forces[1] == forces[2]
    assert forces[0] != forces[1]


def test_contact_of_a_touch_is_on_the_bus_as_its_tpdo_and_record_say(forearm):
    forearm.run(1500)
    cycles, _, frames = forearm.run(200)
    payload = next(f.data for f in reversed(frames) if f.can_id == CONTACT_IDS[0])
    c = unpack_contacts(payload)
    truth = forearm.scene.touches_at(1.6)
    assert (c.link[0], c.state[0]) == (0, ContactState.HELD)
    assert abs(c.s[0] - truth.s[0]) < 2e-3
    assert abs(c.a[0] - truth.a[0]) < 2e-3
    get = forearm.master.device.get
    assert bytes(get(0x3001, sub) & 0xFF for sub in (1, 2)) == payload[:2]
    assert get(0x3001, 25) == np.float32(cycles[-1].contacts.s[0])
    x, y, z, nx, ny, nz = (get(0x3001, sub) for sub in range(12, 18))
    radius = forearm.scene.arm.links[0].surface.radius
    assert np.hypot(y, z) == np.float32(radius) or abs(np.hypot(y, z) - radius) < 1e-6
    assert abs(nx) < 1e-6
    assert np.allclose([ny * radius, nz * radius], [y, z], atol=1e-6)
    assert abs(x - get(0x3001, 25)) < 1e-6


def test_summary_says_counter_contacts_and_patches_alive(forearm):
    forearm.run(1500)
    cycles, _, frames = forearm.run(100)
    data = next(f.data for f in reversed(frames) if f.can_id == SUMMARY_ID)
    last = cycles[-1]
    assert tuple(data[:4]) == (last.counter, len(last.contacts), 24, with_level(0, last.level))


def test_lifted_contact_says_so_once_and_is_gone(rig):
    _, _, frames = rig.run(rig.scene.duration_s * 1e3)
    said = [(f.data[0], f.data[1] >> 4) for f in frames if f.can_id in CONTACT_IDS]
    identities = {identity for identity, _ in said if identity}
    assert identities
    for identity in identities:
        states = [state for i, state in said if i == identity]
        assert states[0] == ContactState.TOUCH
        assert states.count(ContactState.TOUCH) == 1
        assert states[-1] == ContactState.LIFT
        assert states.count(ContactState.LIFT) == 1


@pytest.mark.slow
def test_contact_of_an_unplugged_patch_coasts_says_so_and_is_the_same_when_it_is_back(forearm):
    forearm.run(1500)
    node_id = int(forearm.scene.arm.node_id[forearm.reports[-1].contacts.patch[0]])
    before = forearm.reports[-1].ids.tolist()
    get = forearm.master.device.get
    forearm.patches.unplugged = {node_id}
    _, _, frames = forearm.run(100)
    said = [f.data for f in frames if f.can_id == CONTACT_IDS[0]]
    assert said[-1][1] >> 4 == ContactState.COAST
    assert get(0x3001, 10) >= 60  # ms since it was seen
    forearm.patches.unplugged = set()
    forearm.run(700)
    assert set(before) <= set(forearm.reports[-1].ids.tolist())
    assert get(0x3001, 28) == forearm.reports[-1].tracks.identity[0]


def test_unplugged_patch_is_silent_at_once_and_its_readings_are_not_invented(forearm):
    forearm.run(1500)
    forearm.patches.unplugged = {int(forearm.scene.arm.node_id[forearm.reports[-1].contacts.patch[0]])}
    (node_id,) = forearm.patches.unplugged
    cycles, events, _ = forearm.run(200)
    assert {cycle.n_fresh for cycle in cycles} == {23}
    assert {len(cycle.contacts) for cycle in cycles} == {0}
    assert kinds(events, node_id) == ["readings-lost"]
    assert forearm.state(node_id) == PatchState.SILENT


def test_patch_that_comes_back_without_reboot_is_used_again(forearm):
    forearm.run(1500)
    forearm.patches.unplugged = {24}
    forearm.run(200)
    forearm.patches.unplugged = set()
    cycles, events, _ = forearm.run(700)
    assert "patch-back" in kinds(events, 24)
    assert cycles[-1].n_fresh == 24
    assert forearm.state(24) == PatchState.OPERATIONAL


@pytest.mark.slow
def test_patch_unplugged_for_long_is_absent_and_is_booted_when_it_returns(forearm):
    forearm.run(500)
    forearm.patches.unplugged = {5}
    forearm.run(6000)
    assert forearm.state(5) == PatchState.ABSENT
    assert forearm.reports[-1].n_fresh == 23
    forearm.patches.unplugged = set()
    cycles, events, _ = forearm.run(2500)
    assert "patch-started" in kinds(events, 5)
    assert cycles[-1].n_fresh == 24


@pytest.mark.slow
def test_patch_that_reboots_is_checked_and_started_again(forearm):
    forearm.run(500)
    forearm.device(7).command(cia.NmtCommand.RESET_NODE)
    _, events, _ = forearm.run(1500)
    assert kinds(events, 7)[-1] == "patch-started"
    assert forearm.reports[-1].n_fresh == 24


@pytest.mark.slow
def test_wrong_device_is_refused_never_started_and_accepted_when_it_is_swapped_back(forearm):
    device = forearm.device(3)
    product = device.get(cia.IDENTITY, cia.IDENTITY_PRODUCT)
    device.set(cia.IDENTITY, cia.IDENTITY_PRODUCT, 0xBAD)
    _, events, frames = forearm.run(3500)
    assert kinds(events, 3) == ["patch-refused"]
    assert "0xBAD" in next(e.detail for e in events if e.kind == "patch-refused")
    assert Frame(0, bytes([1, 3])).data not in [f.data for f in frames if f.can_id == 0]
    assert (forearm.state(3), forearm.reports[-1].n_fresh) == (PatchState.WRONG, 23)
    device.set(cia.IDENTITY, cia.IDENTITY_PRODUCT, product)
    forearm.run(2000)
    assert (forearm.state(3), forearm.reports[-1].n_fresh) == (PatchState.OPERATIONAL, 24)


@pytest.mark.slow
def test_absent_patch_costs_the_others_nothing():
    whole, gap = Rig("forearm"), Rig("forearm")
    gap.patches.unplugged = {1}
    for rig in (whole, gap):
        rig.run(300)
    started = [[e.t_ns for e in rig.events if e.kind == "patch-started"] for rig in (whole, gap)]
    assert len(started[1]) == 23
    assert max(started[1]) <= max(started[0]) + 1_000_000
    assert gap.reports[-1].n_fresh == 23
    assert gap.reports[-1].latency_ns <= whole.reports[-1].latency_ns


def test_stop_puts_all_patches_to_pre_operational(forearm):
    forearm.run(300)
    for frame in forearm.master.stop(forearm.wire.clock.now_ns()):
        forearm.world.step(frame.t_ns or forearm.wire.clock.now_ns(), [frame])
    assert {d.nmt_state for d in forearm.world.devices} == {cia.NmtState.PRE_OPERATIONAL}


RIG = Rig("pad")
RIG.run(1000)

IDS = st.one_of(
    st.sampled_from(
        [0x000, 0x080, 0x081, 0x181, 0x281, 0x381, 0x481, 0x581, 0x601, 0x67F, 0x5FF, 0x701, 0x77F, 0x7E5]
    ),
    st.integers(0, 0x7FF),
)


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(IDS, st.binary(max_size=8), st.sampled_from([0, 0, 0, 1, 2])), max_size=8))
def test_frames_that_are_no_reading_change_no_reading(frames):
    readings = RIG.master.gather.plan.cob_ids
    counts = RIG.master.gather.counts.copy()
    foreign = [
        Frame(can_id, data, RIG.wire.clock.now_ns(), flags)
        for can_id, data, flags in frames
        if can_id not in readings or len(data) != 8 or flags
    ]
    step = RIG.master.step(RIG.wire.clock.now_ns(), foreign)
    assert np.array_equal(RIG.master.gather.counts, counts)
    assert step.wake_ns > 0


def test_contacts_are_taken_back_on_the_bus_when_the_master_stops(forearm):
    forearm.run(1700)
    shown = {f.can_id for f in forearm.run(100)[2] if f.can_id in CONTACT_IDS}
    assert shown
    last = forearm.master.stop(forearm.wire.now_ns)
    payloads = {f.can_id: f.data for f in last if f.can_id in CONTACT_IDS}
    assert {can_id: payloads.get(can_id) for can_id in shown} == dict.fromkeys(shown, bytes(8))
    assert (last[-1].can_id, last[-1].data[0]) == (0, cia.NmtCommand.PRE_OPERATIONAL)
