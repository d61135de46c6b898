"""What happens to patches, end to end: the state, the EMCY and the recovery that the documentation says."""

import pytest

from skinbus.can.frame import Frame
from skinbus.master.level_control import CycleFlags
from skinbus.objects import cia
from skinbus.objects.cia import EmcyCode
from tests.master.faults_rig import NODE, STATES, assert_all_well, emcy, last, wake
from tests.master.rig import MS, Rig

pytestmark = pytest.mark.slow


def test_silence_is_8250_then_8130_then_absent_and_heals_by_itself(arm):
    arm.patches.unplugged = {NODE}
    _, _, frames = arm.run(100)
    assert emcy(frames) == [(EmcyCode.RPDO_TIMEOUT, NODE)]
    assert arm.state(NODE) == STATES.SILENT
    _, _, frames = arm.run(2400)
    assert emcy(frames) == [(EmcyCode.HEARTBEAT, NODE)]
    _, _, frames = arm.run(1000)
    assert arm.state(NODE) == STATES.ABSENT
    assert last(arm).n_fresh == 1
    assert arm.master.device.get(cia.ERROR_REGISTER, 0) & cia.ErrorRegister.COMMUNICATION
    arm.patches.unplugged = set()
    _, _, frames = arm.run(2000)
    assert sorted(code for code, _ in emcy(frames)) == [EmcyCode.NO_ERROR] * 2
    assert_all_well(arm)
    flagged = {(report.n_fresh == 2, CycleFlags.INCOMPLETE in report.flags) for report in arm.reports}
    assert flagged == {(True, False), (False, True)}  # at boot, while it is SILENT and while it is ABSENT too


MISHAPS = {
    "heartbeat stops": (lambda device: device.set(cia.HEARTBEAT_PRODUCER, 0, 0), "heartbeat-lost"),
    "reboot": (lambda device: device.command(cia.NmtCommand.RESET_NODE), "patch-rebooted"),
    "stopped": (lambda device: device.command(cia.NmtCommand.STOP), "patch-fell-back"),
    "pre-operational": (lambda device: device.command(cia.NmtCommand.PRE_OPERATIONAL), "patch-fell-back"),
}


@pytest.mark.parametrize(("mishap", "kind"), MISHAPS.values(), ids=MISHAPS)
def test_what_befalls_a_patch_is_8130_and_heals(arm, mishap, kind):
    mishap(arm.device(NODE))
    wake(arm)
    _, events, frames = arm.run(2000)
    assert (EmcyCode.HEARTBEAT, NODE) in emcy(frames)
    assert kind in [event.kind for event in events if event.node_id == NODE]
    arm.device(NODE).set(cia.HEARTBEAT_PRODUCER, 0, 500)
    arm.run(3000)
    assert_all_well(arm)


def two_boards(tmp_path):
    """Nodes 4 and 5 with known serial numbers; node 5 is touched from the first second on."""
    arm_file, scene = tmp_path / "two.toml", tmp_path / "scene.toml"
    arm_file.write_text(
        '[arm]\nname = "two"\nrate_hz = 50.0\n'
        '[[link]]\nname = "plate"\nsurface = "plane"\nlength_mm = 110.0\nwidth_mm = 50.0\n'
        '[[patch]]\nnode_id = 4\nlink = "plate"\ns_mm = 27.0\nserial = 1004\n'
        '[[patch]]\nnode_id = 5\nlink = "plate"\ns_mm = 80.0\nserial = 1005\n'
    )
    scene.write_text(
        f'[scene]\ntitle = "touch"\narm = "{arm_file}"\nduration_s = 60.0\n'
        '[[touch]]\nlink = "plate"\ns_mm = 80.0\na_mm = 2.0\nshape = "disc"\ndiameter_mm = 10.0\n'
        "force_n = 6.0\nstart_s = 1.0\nend_s = 60.0\n"
    )
    return scene


@pytest.fixture
def arm(tmp_path):
    """Two boards, running for half a second."""
    rig = Rig(two_boards(tmp_path), level="kmeans")
    rig.run(500)
    return rig


@pytest.mark.parametrize("when", ["before", "during"])
def test_patch_with_another_serial_number_is_6300_wrong_and_never_started(tmp_path, when):
    rig = Rig(two_boards(tmp_path), level="kmeans")
    device = rig.device(NODE)

    def swap(serial):
        """Unplug the board, plug another in."""
        rig.patches.unplugged = {NODE}
        rig.run(3000)
        device.set(cia.IDENTITY, cia.IDENTITY_SERIAL, serial)
        device.command(cia.NmtCommand.RESET_NODE)
        rig.patches.unplugged = set()

    if when == "during":
        rig.run(500)
        assert rig.state(NODE) == STATES.OPERATIONAL
        swap(77)
    else:
        device.set(cia.IDENTITY, cia.IDENTITY_SERIAL, 77)
    n_before = len(rig.frames)
    rig.run(2500)
    frames = rig.frames[n_before:]
    assert rig.state(NODE) == STATES.WRONG
    assert (EmcyCode.SOFTWARE_DATA_SET, NODE) in emcy(frames)
    started = bytes([cia.NmtCommand.START, NODE])
    assert started not in [f.data for f in frames if f.can_id == cia.NMT_COMMAND_ID]
    assert device.nmt_state is cia.NmtState.PRE_OPERATIONAL
    assert last(rig).n_fresh == 1
    swap(1005)
    rig.run(3000)
    assert_all_well(rig)


def test_readings_of_a_wrong_board_that_somebody_starts_make_no_contacts_and_it_is_stopped(tmp_path):
    rig = Rig(two_boards(tmp_path), level="kmeans")
    device = rig.device(NODE)
    device.set(cia.IDENTITY, cia.IDENTITY_SERIAL, 77)
    rig.run(2000)
    assert rig.state(NODE) == STATES.WRONG
    rig.say(Frame(cia.NMT_COMMAND_ID, bytes([cia.NmtCommand.START, 0])))
    rig.run(1)
    assert device.nmt_state is cia.NmtState.OPERATIONAL
    cycles, _, frames = rig.run(2000)
    assert {cycle.n_fresh for cycle in cycles} == {1}
    assert {len(cycle.contacts) for cycle in cycles} == {0}
    assert rig.master.device.get(0x2100, 3) == 1
    assert device.nmt_state is cia.NmtState.PRE_OPERATIONAL
    stops = bytes([cia.NmtCommand.PRE_OPERATIONAL, NODE])
    assert [f.data for f in frames if f.can_id == cia.NMT_COMMAND_ID] == [stops]
    assert rig.state(NODE) == STATES.WRONG


def test_bus_dead_for_five_seconds_shows_nothing_stale_and_heals_by_itself(arm):
    arm.run(1000)
    assert len(last(arm).contacts) > 0
    cut_ns = arm.wire.now_ns
    arm.patches.is_cut = True
    cycles, _, frames = arm.run(5000)
    after = [cycle for cycle in cycles if cycle.t_ns > cut_ns]
    assert len(after) > 240
    assert {cycle.n_fresh for cycle in after} == {0}
    assert {len(cycle.contacts) for cycle in after} == {0}
    get = arm.master.device.get
    assert [get(0x3001 + k, 5) for k in range(16)] == [0] * 16  # no force anywhere
    assert get(0x2301, NODE) >= 4900  # ms since its last readings
    assert {code for code, _ in emcy(frames)} == {EmcyCode.RPDO_TIMEOUT, EmcyCode.HEARTBEAT}
    arm.patches.is_cut = False
    healed_ns = arm.wire.now_ns
    cycles, _, _ = arm.run(2500)
    assert_all_well(arm)
    whole = next(cycle.t_ns for cycle in cycles if cycle.n_fresh == 2)
    assert whole - healed_ns < 2_000_000_000


def test_reading_of_wrong_length_is_counted_and_changes_nothing(arm):
    while not arm.master.gather.is_open:
        arm.run(0.05)
    arm.say(Frame(0x180 + NODE, b"\x12\x34\x56"))
    _, _, frames = arm.run(100)
    assert arm.master.gather.counters.bad_length == 1
    assert not emcy(frames)
    assert_all_well(arm)


def complaint(code, register):
    return Frame(0x80 + NODE, code.to_bytes(2, "little") + bytes([register]) + bytes(5))


def test_emcy_is_over_when_the_error_register_says_so_not_with_the_first_error_that_goes(arm):
    arm.say(complaint(0x8150, 0x11), complaint(0x4210, 0x19))
    arm.run(50)
    for code in (0x0000, 0x0010):  # one of the two errors is over
        arm.say(complaint(code, 0x11))
        _, events, frames = arm.run(50)
        assert events == []
        assert emcy(frames) == []
        assert arm.master.device.get(0x2302, NODE) == 0x4210
    arm.say(complaint(0x0000, 0))
    _, _, frames = arm.run(50)
    assert [code for code, _ in emcy(frames)] == [EmcyCode.NO_ERROR]
    assert arm.master.device.get(0x2302, NODE) == 0
    assert_all_well(arm)


def test_patch_that_lives_but_sends_nothing_is_configured_again_without_a_reset():
    arm = Rig("forearm", level="kmeans")
    arm.run(500)
    device = arm.device(NODE)
    transmission = device.get(0x1800, 2)
    device.set(0x1800, 2, 254)  # no longer with SYNC: a write that no mark tells the master of
    resets = Frame(cia.NMT_COMMAND_ID, bytes([cia.NmtCommand.RESET_NODE, NODE])).data
    _, _, frames = arm.run(4900)
    assert not [frame for frame in frames if frame.can_id == 0 and frame.data == resets]
    assert device.get(0x1800, 2) == transmission
    assert_all_well(arm, n_patches=24)


@pytest.mark.parametrize("reset", [cia.NmtCommand.RESET_COMMUNICATION, cia.NmtCommand.RESET_NODE])
def test_emcy_between_boot_up_and_start_is_shown_until_the_patch_takes_it_back(arm, reset):
    device = arm.device(NODE)
    arm.say(Frame(cia.NMT_COMMAND_ID, bytes([reset, NODE])))
    row = arm.scene.arm.patch_at(NODE)
    while arm.master.table.state[row] != STATES.BOOTING and arm.wire.now_ns < 600 * MS:
        arm.run(0.1)
    device.emcy(0x5010)
    wake(arm)
    _, _, frames = arm.run(200)
    assert arm.state(NODE) == STATES.OPERATIONAL
    assert arm.master.device.get(0x2302, NODE) == 0x5010
    assert emcy(frames)[-1][0] == EmcyCode.NO_ERROR  # of its reboot: that is over
    assert arm.master.device.get(cia.ERROR_REGISTER, 0) != 0
    device.emcy_clear(0x5010)
    wake(arm)
    _, _, frames = arm.run(100)
    assert [code for code, _ in emcy(frames)] == [EmcyCode.NO_ERROR]
    assert arm.master.device.get(0x2302, NODE) == 0
    assert_all_well(arm)
