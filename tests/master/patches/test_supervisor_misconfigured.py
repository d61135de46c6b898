"""Patches whose communication objects another tool has changed: repaired or WRONG, never used as they are."""

import pytest

from skinbus.master.patches.table import PatchState
from skinbus.objects import cia
from tests.master.commission import Bench, patch
from tests.master.misbehaving import SAVE, Stubborn, Tool, all_pdos_off, swapped_mappings
from tests.master.rig import Rig

NODE = 1


def let(wire, tool):
    """Let a tool do its work."""
    port = wire.attach(tool)
    while not tool.is_done:
        wire.run(wire.now_ns + 1_000_000)
    wire.detach(port)
    assert not tool.faults


def stored(writes, **settings):
    """A patch in which a tool has stored this, then powered on again."""
    storage = {}
    device = patch(NODE, storage=storage, **settings)
    let(Bench(device).wire, Tool(NODE, writes(device)))
    return patch(NODE, storage=storage, **settings)


CHANGES = {
    "swapped mappings": swapped_mappings,
    "no heartbeat": lambda _: [(cia.HEARTBEAT_PRODUCER, 0, bytes(2)), (cia.STORE_PARAMETERS, 1, SAVE)],
    "another heartbeat": lambda _: [
        (cia.HEARTBEAT_PRODUCER, 0, b"\x88\x13"),
        (cia.STORE_PARAMETERS, 1, SAVE),
    ],
    "TPDO by event": lambda _: [(0x1801, 2, b"\xff"), (cia.STORE_PARAMETERS, 1, SAVE)],
    "TPDOs off": lambda device: [*all_pdos_off(device), (cia.STORE_PARAMETERS, 1, SAVE)],
    "another SYNC": lambda _: [(cia.SYNC_COB_ID, 0, b"\x81\0\0\0"), (cia.STORE_PARAMETERS, 1, SAVE)],
}


@pytest.mark.parametrize("name", CHANGES)
def test_stored_change_of_another_tool_is_repaired_before_the_start(name):
    device = stored(CHANGES[name])
    wanted = patch(NODE)
    bench = Bench(device)
    bench.start()
    bench.pass_ms(3000)
    for index in (cia.SYNC_COB_ID, cia.HEARTBEAT_PRODUCER):
        assert device.get(index) == wanted.get(index)
    for n in range(4):
        for index, subs in ((cia.TPDO_COMMUNICATION + n, (1, 2)), (cia.TPDO_MAPPING + n, range(5))):
            assert [device.get(index, sub) for sub in subs] == [wanted.get(index, sub) for sub in subs]
    kinds = [event.kind for event in bench.events]
    assert kinds.count("patch-configured") == 1
    assert kinds.count("patch-started") == 1
    assert not {"heartbeat-lost", "readings-lost", "patch-rebooted"} & set(kinds)
    assert bench.reports[-1].n_fresh == 1


def test_patch_that_does_not_take_what_the_pipeline_needs_is_wrong_and_never_started():
    bench = Bench(Stubborn(patch(NODE), 0x1801, 2, 0xFF))
    master = bench.start()
    bench.pass_ms(2000)
    assert master.table.state[0] == PatchState.WRONG
    (refused,) = [event for event in bench.events if event.kind == "patch-refused"]
    assert "0x1801:02" in refused.detail
    assert bytes([cia.NmtCommand.START, NODE]) not in [f.data for f in bench.frames if f.can_id == 0]


@pytest.mark.slow
def test_change_of_another_tool_while_it_runs_is_not_used_and_taken_back():
    rig = Rig("pad")
    rig.run(1500)
    device = rig.device(NODE)
    before = [device.get(cia.TPDO_MAPPING + k, 1) for k in range(2)]
    *writes, _ = swapped_mappings(device)  # all but storing it
    n = len(rig.reports)
    let(rig.wire, Tool(NODE, writes))
    rig.run(1500)
    assert [device.get(cia.TPDO_MAPPING + k, 1) for k in range(2)] == before
    assert any("another client writes" in event.detail for event in rig.events)
    assert not any(report.n_fresh for report in rig.reports[n + 1 : n + 50])  # n: under way when it began
    assert rig.reports[-1].n_fresh == 1
    assert not any(port.error_counter for port in rig.wire.ports)
