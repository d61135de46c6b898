"""Requests of clients for NMT commands (0x1F82): the master gives them, and knows that it did."""

import struct

import pytest

from skinbus.can.frame import Frame
from skinbus.objects import cia
from skinbus.objects.cia import AbortCode, NmtCommand
from tests.master.buses_rig import ON_LEFT, ON_RIGHT, RIGHT, BusesRig, write_scene
from tests.master.faults_rig import emcy
from tests.master.rig import Rig

pytestmark = pytest.mark.slow

MASTER, NODE, ALL = 127, 5, 0x80
RESET_NODE, RESET_COMMUNICATION = 0x06, 0x07
COMMANDS = {RESET_NODE: NmtCommand.RESET_NODE, RESET_COMMUNICATION: NmtCommand.RESET_COMMUNICATION}


@pytest.fixture(scope="module")
def running():
    """A forearm that has run for half a second; tests leave it as they found it."""
    rig = Rig("forearm", level="kmeans")
    rig.run(500)
    return rig


def ask(rig, sub, value, ms=30):
    """Write 0x1F82 as a client does; return the abort code (0: none) and the NMT frames that followed."""
    rig.say(Frame(cia.SDO_CLIENT_BASE + MASTER, struct.pack("<BHBI", 0x2F, cia.REQUEST_NMT, sub, value)))
    _, _, frames = rig.run(ms)
    (answer,) = (f.data for f in frames if f.can_id == cia.SDO_SERVER_BASE + MASTER)
    abort = int.from_bytes(answer[4:], "little") if answer[0] == 0x80 else 0
    return abort, [tuple(f.data) for f in frames if f.can_id == cia.NMT_COMMAND_ID]


@pytest.mark.parametrize("value", [RESET_NODE, RESET_COMMUNICATION, 0x86, 0x87])
def test_patch_that_a_client_resets_boots_and_is_started_without_alarm(running, value):
    before = running.wire.clock.now_ns()
    abort, commands = ask(running, NODE, value, ms=300)
    assert (abort, commands) == (0, [(COMMANDS[value & 0x7F], NODE), (NmtCommand.START, NODE)])
    since = [f for f in running.frames if f.t_ns >= before]
    assert emcy(since) == []
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


def test_master_itself_is_reset_and_with_it_each_patch_but_not_by_a_broadcast(running):
    abort, commands = ask(running, MASTER, RESET_COMMUNICATION, ms=1500)
    assert abort == 0
    nodes = running.scene.arm.node_id.tolist()
    assert commands[: len(nodes)] == [(NmtCommand.RESET_COMMUNICATION, node) for node in nodes]
    assert running.reports[-1].n_fresh == 24


def test_other_commands_and_nodes_are_refused(running):
    for sub, value in (NODE, 0x04), (NODE, 0x05), (NODE, 0x7F), (ALL, 0x04), (99, RESET_NODE), (NODE, 1):
        assert ask(running, sub, value) == (AbortCode.LOCAL_CONTROL, []), (sub, value)


@pytest.mark.parametrize("sub", [1, ALL])
def test_node_of_a_bus_commands_the_patches_of_that_bus_only(tmp_path, sub):
    rig = BusesRig(write_scene(tmp_path, [ON_LEFT, ON_RIGHT]))
    rig.run(300)
    assert rig.reports[-1].n_fresh == 2
    device = rig.master.branches[RIGHT].device
    assert device.on_write(cia.REQUEST_NMT, sub, 0x86) is None
    _, _, frames = rig.run(500)
    commands = [[tuple(f.data) for f in part if f.can_id == cia.NMT_COMMAND_ID] for part in frames]
    assert commands == [[], [(NmtCommand.RESET_NODE, 0 if sub == ALL else 1), (NmtCommand.START, 1)]]
    assert rig.reports[-1].n_fresh == 2
