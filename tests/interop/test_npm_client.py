"""The JavaScript stack as client of our patch: what it asks, our device answers."""

from itertools import product

import numpy as np
import pytest

from skinbus.node import Device
from skinbus.objects.cia import NmtState
from skinbus.objects.eds import load_eds
from tests.interop.peer import PeerError, resolved_eds

NODE = 5
PEER = 100
INTEGER16 = 3


@pytest.fixture
def patch(bench):
    """Our patch, booted, and the peer open as a client of it."""
    device = Device(load_eds("skin-patch", NODE), NODE)
    device.port = bench.attach(device)
    bench.ask("open", id=PEER, eds=None)
    bench.ask("addServer", node=NODE)
    bench.ask("watchEmcy", cobId=0x80 + NODE)
    bench.ask("start")
    return device


def test_boot_up_and_heartbeat_are_seen_and_their_loss_too(bench, patch):
    bench.ask("watchHeartbeat", node=NODE, ms=300)
    bench.ask("download", node=NODE, index=0x1017, sub=0, data="6400")
    bench.pass_ms(500)
    bench.ask("nmt", command="startNode", node=NODE)
    bench.pass_ms(500)
    assert [told["state"] for told in bench.peer.told("heartbeat")] == [127, 5]
    assert bench.peer.told("timeout") == []
    bench.wire.detach(patch.port)
    bench.pass_ms(1000)
    assert bench.peer.told("timeout") == [{"node": NODE}]


def test_nmt_commands_are_obeyed(bench, patch):
    states = {
        "startNode": NmtState.OPERATIONAL,
        "stopNode": NmtState.STOPPED,
        "enterPreOperational": NmtState.PRE_OPERATIONAL,
        "resetNode": NmtState.PRE_OPERATIONAL,
        "resetCommunication": NmtState.PRE_OPERATIONAL,
    }
    for command, node in product(states, (NODE, 0)):
        bench.ask("nmt", command="startNode", node=NODE)
        n_before = len(bench.frames)
        bench.ask("nmt", command=command, node=node)
        bench.pass_ms(10)
        assert patch.nmt_state is states[command]
        boot_ups = [f for f in bench.frames[n_before:] if f.can_id == 0x700 + NODE and f.data == b"\0"]
        assert len(boot_ups) == command.startswith("reset")


def test_uploads_are_expedited_or_in_blocks(bench, patch):
    patch.set(0x1017, 0, 1000)
    for index, sub, data in (
        (0x1000, 0, "91010400"),
        (0x1001, 0, "00"),
        (0x1017, 0, "e803"),
        (0x1018, 0, "04"),
        (0x1018, 1, "424e4b53"),
        (0x1800, 2, "01"),
    ):
        assert bench.ask("upload", node=NODE, index=index, sub=sub) == data
    for index in (0x1008, 0x1009, 0x100A):
        data = bench.ask("upload", node=NODE, index=index, sub=0, block=True)
        assert bytes.fromhex(data).decode() == patch.get(index, 0)


def test_refusals_reach_the_client_with_their_abort_code(bench, patch):
    for verb, index, sub, data, code in (
        ("upload", 0x5FFF, 0, None, 0x06020000),
        ("upload", 0x1018, 9, None, 0x06090011),
        ("download", 0x1000, 0, "00000000", 0x06010002),
        ("download", 0x1017, 0, "00000000", 0x06070012),
        ("download", 0x1017, 0, "00", 0x06070013),
        ("download", 0x1800, 2, "f1", 0x06090030),
        ("download", 0x1A00, 1, "20000220", 0x06010000),
    ):
        with pytest.raises(PeerError) as caught:
            bench.ask(verb, node=NODE, index=index, sub=sub, data=data)
        assert caught.value.code == code


def test_readings_in_tpdos_on_sync_are_decoded(bench, patch):
    counts = np.arange(-8, 8, dtype=np.int16) * 1000 + 1
    patch.on_sync = lambda now_ns, counter: patch.image_view(0x6401, 1, 16).__setitem__(slice(None), counts)
    for k in range(4):
        bench.ask(
            "receivePdo",
            cobId=0x180 + 0x100 * k + NODE,
            index=0x4000 + 4 * k,
            names=[f"Tactel {4 * k + i + 1}" for i in range(4)],
            dataType=INTEGER16,
        )
    bench.ask("nmt", command="startNode", node=0)  # the peer takes PDOs in its own OPERATIONAL only
    bench.ask("sync", counter=None)
    bench.pass_ms(10)
    told = {event["cobId"]: event["values"] for event in bench.peer.told("pdo")}
    assert told == {0x180 + 0x100 * k + NODE: counts[4 * k : 4 * k + 4].tolist() for k in range(4)}


def test_emergency_and_its_end_are_understood(bench, patch):
    patch.emcy(0x5000, b"\x01\x02")
    bench.wire.wake(patch.port)
    bench.pass_ms(200)
    patch.emcy_clear(0x5000)
    bench.wire.wake(patch.port)
    bench.pass_ms(200)
    first, last = bench.peer.told("emcy")
    assert (first["code"], first["register"] & 1, first["info"][:4]) == (0x5000, 1, "0102")
    assert "hardware" in first["text"]
    assert (last["code"], last["register"]) == (0, 0)
    assert bench.ask("upload", node=NODE, index=0x1001, sub=0) == "00"


@pytest.mark.parametrize(
    ("name", "n_transmit", "size"),
    [("skin-patch", 4, 8), ("skin-patch-8bit", 2, 8), ("skin-master", 17, 8)],
)
def test_eds_is_read_by_a_reader_nobody_here_wrote(bench, tmp_path, name, n_transmit, size):
    read = bench.ask("readEds", eds=str(resolved_eds(name, NODE, tmp_path)))
    od = load_eds(name, NODE)
    assert {index for index in read["objects"] if index >= 0x1000} == {
        index for index in od if index >= 0x1000
    }
    transmit = [pdo for pdo in read["transmit"] if pdo]
    assert len(transmit) == n_transmit
    assert {pdo["size"] for pdo in transmit} <= {size, 7, 8}
