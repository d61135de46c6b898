"""The JavaScript stack and our master: it reads contacts as a client, and is booted as a patch."""

import struct

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.master.patches.table import PatchState
from skinbus.node import Device
from skinbus.objects.eds import load_eds
from skinbus.sim import World, load_scene
from tests.interop.peer import resolved_eds

pytestmark = pytest.mark.slow

MASTER, PEER = 127, 100
CONTACT_1 = 0x3001
CONTACT_1_ID = 0x681
TYPES = {"U8": 5, "I16": 3, "U16": 6}


def number(data, form):
    """One little-endian number from hexadecimal text."""
    return struct.unpack("<" + form, bytes.fromhex(data))[0]


def test_client_reads_contacts_by_sdo_and_receives_their_tpdo(bench):
    scene = load_scene("pad")
    bench.attach(World(scene))
    bench.start()
    cycles = bench.reports
    bench.pass_ms(200)  # the master resets all nodes when it begins, the client too
    bench.ask("open", id=PEER, eds=None)
    bench.ask("addServer", node=MASTER)
    bench.ask("start")
    bench.ask(
        "receivePdo",
        cobId=CONTACT_1_ID,
        index=0x4000,
        names=["Id", "Link and state", "s", "a", "Force"],
        dataType=[TYPES[name] for name in ("U8", "U8", "I16", "I16", "U16")],
    )
    bench.ask("nmt", command="startNode")  # itself: it takes PDOs only when OPERATIONAL
    for _ in range(500):
        bench.pass_ms(20)
        if bench.peer.told("pdo") and len(cycles[-1].contacts) == 1:
            break
    last = cycles[-1]
    assert len(last.contacts) == 1
    id_, _, s, a, force = bench.peer.told("pdo")[-1]["values"]
    # Half a unit of the TPDO: 0.1 mm, 0.01 N.
    wanted = [last.contacts.s[0] * 1e4, last.contacts.a[0] * 1e4, last.contacts.force[0] * 1e2]
    np.testing.assert_allclose([s, a, force], wanted, atol=0.5 + 1e-6)
    assert id_ == last.ids[0]

    # By SDO the exact numbers; the cycle goes on meanwhile, so compare with the cycles around.
    before = len(cycles)
    seen = number(bench.ask("upload", node=MASTER, index=CONTACT_1, sub=5), "H")
    forces = [cycle.contacts.force[0] * 1e2 for cycle in cycles[before - 1 :] if len(cycle.contacts)]
    assert min(abs(seen - force) for force in forces) <= 0.5 + 1e-6
    assert number(bench.ask("upload", node=MASTER, index=0x1018, sub=0), "B") == 4


def test_device_of_another_make_is_booted_and_its_readings_become_a_contact(bench, tmp_path):
    arm = load_arm("pad")
    node_id = int(arm.node_id[0])
    bench.ask("open", id=node_id, eds=str(resolved_eds("skin-patch", node_id, tmp_path)))
    master = bench.start()
    cycles = bench.reports
    bench.ask("start")
    bench.pass_ms(3000)
    assert [PatchState(state) for state in master.table.state] == [PatchState.OPERATIONAL]
    assert cycles[-1].n_fresh == 1
    assert len(cycles[-1].contacts) == 0

    # A press on the middle of the board: the four tactels there at 40 % of full scale, the rest at 5 %.
    middle = {6, 7, 10, 11}
    for sub in range(1, 17):
        counts = round(0x7FFF * (0.4 if sub in middle else 0.05))
        bench.ask("setRaw", index=0x6401, sub=sub, data=struct.pack("<h", counts).hex())
    bench.pass_ms(200)
    contacts = cycles[-1].contacts
    assert len(contacts) == 1
    placed = arm.patches[0]
    assert abs(contacts.s[0] - placed.s) < 1e-3
    assert abs(contacts.a[0] - placed.a) < 1e-3


def test_fastscan_finds_a_patch_without_node_id_and_gives_it_one(bench):
    od = load_eds("skin-patch", 1)
    patch = Device(od, 255, storage={})
    bench.attach(patch)
    bench.ask("open", id=PEER, eds=None)
    bench.ask("startLss")
    found = bench.ask("fastscan", timeout=20)
    assert found == {
        "vendorId": patch.get(0x1018, 1),
        "productCode": patch.get(0x1018, 2),
        "revisionNumber": patch.get(0x1018, 3),
        "serialNumber": patch.get(0x1018, 4),
    }
    bench.ask("lssNode", node=42)
    bench.ask("lssStore")
    bench.ask("lssMode", mode=0)
    bench.pass_ms(100)
    assert patch.node_id == 42
    boot_up = next(frame for frame in bench.frames if frame.can_id == 0x700 + 42)
    assert boot_up.data == b"\0"


def test_consumer_of_our_sync_emcy_and_pdos_sees_no_error_with_default_settings(bench):
    scene = load_scene("pad")
    node_id = int(scene.arm.node_id[0])
    world = World(scene)
    bench.attach(world)
    bench.start()
    bench.pass_ms(200)
    bench.ask("open", id=PEER, eds=None)
    bench.ask("start")
    bench.ask("consumeSync")
    for node in (MASTER, node_id):
        bench.ask("watchEmcy", cobId=0x80 + node)
    bench.ask(
        "receivePdo", cobId=0x180 + node_id, index=0x4000, names=["1", "2", "3", "4"], dataType=TYPES["I16"]
    )
    bench.ask("nmt", command="startNode")
    begin = len(bench.frames)
    bench.pass_ms(3000)
    n_syncs = sum(frame.can_id == 0x80 for frame in bench.frames[begin:])
    assert n_syncs > 50
    assert [sync["counter"] for sync in bench.peer.told("sync")][-n_syncs:] == [""] * n_syncs
    last = bench.peer.told("pdo")[-1]  # it tells of those that change
    assert last["values"] == [int(world.devices[0].get(0x6401, k)) for k in range(1, 5)]
    assert not [emcy for emcy in bench.peer.told("emcy") if emcy["code"]]
    world.devices[0].emcy(0x5000)
    bench.pass_ms(600)
    assert [emcy["code"] for emcy in bench.peer.told("emcy") if emcy["cobId"] == 0x80 + node_id] == [0x5000]
    assert world.devices[0].get(0x1001) & 1
