"""Requests of clients for NMT commands (0x1F82): the master gives them, and knows that it did."""

import struct

import pytest

from skinbus.can.frame import Frame
from skinbus.master.patches.supervisor import MUTE_NS
from skinbus.master.patches.table import PatchState
from skinbus.objects import cia
from skinbus.objects.cia import AbortCode, NmtCommand, NmtState
from tests.master.buses_rig import LEFT, ON_LEFT, ON_RIGHT, RIGHT, BusesRig, write_scene
from tests.master.faults_rig import emcy
from tests.master.rig import MS, Rig
from tests.master.sdo_reads import number

MASTER, NODE, ALL = 127, 5, 0x80
STOP, START, RESET_NODE, RESET_COMMUNICATION, PRE_OPERATIONAL = 0x04, 0x05, 0x06, 0x07, 0x7F
HOLDS = [(STOP, NmtState.STOPPED), (PRE_OPERATIONAL, NmtState.PRE_OPERATIONAL)]
COMMANDS = {
    STOP: NmtCommand.STOP,
    START: NmtCommand.START,
    RESET_NODE: NmtCommand.RESET_NODE,
    RESET_COMMUNICATION: NmtCommand.RESET_COMMUNICATION,
    PRE_OPERATIONAL: NmtCommand.PRE_OPERATIONAL,
}


@pytest.fixture(scope="module")
def running():
    """A forearm that has run for half a second; tests leave it as they found it."""
    rig = Rig("forearm")
    rig.run(500)
    return rig


def ask(rig, sub, value, ms=30):
    """Write 0x1F82 as a client does; return the abort code (0: none) and the NMT frames that followed."""
    rig.say(Frame(cia.SDO_CLIENT_BASE + MASTER, struct.pack("<BHBI", 0x2F, cia.REQUEST_NMT, sub, value)))
    _, _, frames = rig.run(ms)
    (answer,) = (f.data for f in frames if f.can_id == cia.SDO_SERVER_BASE + MASTER)
    abort = int.from_bytes(answer[4:], "little") if answer[0] == 0x80 else 0
    return abort, [tuple(f.data) for f in frames if f.can_id == cia.NMT_COMMAND_ID]


@pytest.mark.slow
@pytest.mark.parametrize(("value", "state"), HOLDS)
def test_patch_that_a_client_stops_stays_stopped_and_is_no_fault(running, value, state):
    assert ask(running, NODE, value) == (0, [(COMMANDS[value], NODE)])
    cycles, events, frames = running.run(MUTE_NS // MS + 100)
    assert running.device(NODE).nmt_state is state
    assert running.state(NODE) == PatchState.HELD
    assert number(running.master, cia.REQUEST_NMT, NODE) == state
    assert {cycle.n_fresh for cycle in cycles} == {23}
    assert not [event for event in events if event.node_id == NODE]
    assert emcy(frames) == []
    assert ask(running, NODE, START) == (0, [(NmtCommand.START, NODE)])
    running.run(100)
    assert running.state(NODE) == PatchState.OPERATIONAL
    assert number(running.master, cia.REQUEST_NMT, NODE) == NmtState.OPERATIONAL
    assert running.reports[-1].n_fresh == 24


@pytest.mark.parametrize("value", [RESET_NODE, RESET_COMMUNICATION, 0x86, 0x87])
def test_patch_that_a_client_resets_boots_and_is_started_without_alarm(running, value):
    before = running.wire.clock.now_ns()
    abort, commands = ask(running, NODE, value, ms=300)
    assert (abort, commands) == (0, [(COMMANDS[value & 0x7F], NODE), (NmtCommand.START, NODE)])
    since = [f for f in running.frames if f.t_ns >= before]
    assert emcy(since) == []
    assert running.reports[-1].n_fresh == 24


@pytest.mark.parametrize(("value", "state"), [*HOLDS, (0x84, HOLDS[0][1]), (0x8F, HOLDS[1][1])])
def test_all_are_stopped_and_started_by_one_command(running, value, state):
    command = COMMANDS[PRE_OPERATIONAL if value == 0x8F else value & 0x7F]
    assert ask(running, ALL, value) == (0, [(command, 0)])
    cycles, _, _ = running.run(1600)
    assert {device.nmt_state for device in running.world.devices} == {state}
    assert running.master.device.nmt_state is NmtState.OPERATIONAL
    assert {cycle.n_fresh for cycle in cycles} == {0}
    assert number(running.master, cia.REQUEST_NMT, ALL) == 0
    assert ask(running, ALL, START) == (0, [(NmtCommand.START, 0)])
    running.run(100)
    assert running.reports[-1].n_fresh == 24


def test_reset_of_all_includes_the_master_unless_it_is_left_out(running):
    boot_up = Frame(cia.HEARTBEAT_BASE + MASTER, b"\0")
    for value, n in ((0x87, 0), (RESET_COMMUNICATION, 1)):
        start = len(running.frames)
        abort, commands = ask(running, ALL, value, ms=1500)
        assert (abort, commands[0]) == (0, (NmtCommand.RESET_COMMUNICATION, 0))
        seen = [f._replace(t_ns=0) for f in running.frames[start:]]
        assert seen.count(boot_up) == n
        assert running.reports[-1].n_fresh == 24


def test_master_itself_is_reset_and_started_but_not_stopped(running):
    for value in (STOP, PRE_OPERATIONAL):
        assert ask(running, MASTER, value) == (AbortCode.DEVICE_STATE, [])
    assert ask(running, MASTER, START) == (0, [])
    abort, commands = ask(running, MASTER, RESET_COMMUNICATION, ms=1500)
    assert (abort, commands[0]) == (0, (NmtCommand.RESET_COMMUNICATION, 0))
    assert running.reports[-1].n_fresh == 24


def test_wrong_patch_is_not_started_by_anybody(forearm):
    forearm.device(NODE).set(cia.IDENTITY, cia.IDENTITY_PRODUCT, 0xBAD)
    forearm.run(500)
    assert forearm.state(NODE) == PatchState.WRONG
    assert ask(forearm, NODE, START)[0] == AbortCode.DEVICE_STATE
    abort, commands = ask(forearm, ALL, START)
    assert abort == 0
    assert sorted(commands) == sorted(
        (NmtCommand.START, n) for n in forearm.scene.arm.node_id.tolist() if n != NODE
    )
    assert forearm.device(NODE).nmt_state is NmtState.PRE_OPERATIONAL


@pytest.mark.parametrize(("value", "state"), HOLDS)
def test_held_patch_stays_held_through_its_reboot_and_is_held_again_when_somebody_starts_it(
    rig, value, state
):
    rig.run(300)
    assert ask(rig, 1, value)[0] == 0
    rig.say(Frame(cia.NMT_COMMAND_ID, bytes([NmtCommand.RESET_NODE, 1])))
    _, events, _ = rig.run(3000)
    assert rig.device(1).nmt_state is state
    assert rig.state(1) == PatchState.HELD
    assert [event.kind for event in events if event.node_id == 1] == ["patch-held"]
    rig.say(Frame(cia.NMT_COMMAND_ID, bytes([NmtCommand.START, 1])))
    rig.run(1500)
    assert rig.device(1).nmt_state is state
    assert ask(rig, 1, START)[0] == 0
    rig.run(200)
    assert rig.reports[-1].n_fresh == 1


@pytest.mark.parametrize("sub", [1, ALL])
def test_node_of_a_bus_commands_the_patches_of_that_bus_only(tmp_path, sub):
    rig = BusesRig(write_scene(tmp_path, [ON_LEFT, ON_RIGHT]))
    rig.run(300)
    assert rig.reports[-1].n_fresh == 2
    device = rig.master.branches[RIGHT].device
    assert device.on_write(cia.REQUEST_NMT, sub, STOP) is None
    _, events, frames = rig.run(500)
    commands = [[tuple(f.data) for f in part if f.can_id == cia.NMT_COMMAND_ID] for part in frames]
    assert commands == [[], [(NmtCommand.STOP, 0 if sub == ALL else 1)]]
    assert [(event.kind, event.bus) for event in events if event.node_id == 1] == [("patch-held", RIGHT)]
    assert [rig.get(bus, 0x2300, 1) for bus in (LEFT, RIGHT)] == [PatchState.OPERATIONAL, PatchState.HELD]
    assert rig.reports[-1].n_fresh == 1
    assert device.on_write(cia.REQUEST_NMT, sub, START) is None
    rig.run(200)
    assert rig.reports[-1].n_fresh == 2
