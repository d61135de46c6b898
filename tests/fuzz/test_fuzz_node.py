"""Random frames into the device cores: no exception, no wrong state, no reading changed, memory flat."""

from itertools import islice

import pytest

from skinbus.can.frame import Frame
from skinbus.node import Device
from skinbus.node.lss import LSS_MASTER_ID
from skinbus.node.nmt import TRANSITIONS
from skinbus.objects.cia import NmtCommand, NmtState
from skinbus.objects.eds import load_eds
from tests.firmware.traffic import Traffic
from tests.fuzz.feeding import N_FRAMES, feed
from tests.run_in_process import run_in_process

SEED = 20260101
DEVICES = {"patch": ("skin-patch", 5, 0x6401, 16), "master": ("skin-master", 127, 0x3001, 5)}
"""EDS, node-ID, and the readings or contacts that no frame may change."""
MAX_GROWTH = 400_000
"""Bytes that a device may come to hold while it is fed: domains and queues have bounds."""

# A state follows another only like this: by a command, by the end of a boot, or by an error (0x1029).
FOLLOWS = {(before, after) for before in NmtState for after in TRANSITIONS.values()}
FOLLOWS |= {(NmtState.INITIALISING, NmtState.PRE_OPERATIONAL)}


def fuzz(which, n_frames):
    """Feed one device; return how many frames it sent and dropped, and how often it was reset."""
    eds, node_id, index, n_subs = DEVICES[which]
    device = Device(load_eds(eds, node_id), node_id, storage={})
    readings = device.image_view(index, 1, n_subs)
    before, traffic = readings.tobytes(), Traffic(device.layout, node_id, SEED)
    traffic.kinds += (traffic.block, traffic.block)
    last, n_resets = device.nmt_state, 0

    def enter(state):
        nonlocal last, n_resets
        assert (last, state) in FOLLOWS, f"{last.name} -> {state.name}"
        n_resets += state is NmtState.INITIALISING
        last = state

    def frames(n):
        return ((1000 * us, frame) for us, frame in islice(iter(traffic), n))

    def after_chunk():
        assert device.nmt_state in NmtState
        assert readings.tobytes() == before, "a reading has changed"
        assert device.get(0x1003, 0) <= 8
        device.transmit_tpdo(1)
        device.emcy(0x5000, data=bytes(1))
        device.emcy_clear(0x5000)

    device.on_nmt = enter
    sent, now_ns = feed(device, n_frames, frames, after_chunk, least_id=1, max_growth=MAX_GROWTH)
    # after all that, a reset and a read are answered as on the first day
    for data in (bytes((4, 1)), bytes((0x11, 5)), bytes((4, 0))):  # a node-ID, in case it has lost its own
        device.step(now_ns, [Frame(0, bytes((128, 0))), Frame(LSS_MASTER_ID, data.ljust(8, b"\0"))])
    device.command(NmtCommand.RESET_NODE)
    device.step(now_ns)
    request = Frame(0x600 + device.node_id, bytes.fromhex("4001100000000000"))
    answer = device.step(now_ns, (request,)).frames[-1]
    assert (answer.can_id, answer.data[:4]) == (0x580 + device.node_id, bytes.fromhex("4F011000"))
    return sent, device.dropped, n_resets


def fuzz_all(n_frames):
    return [fuzz(which, n_frames) for which in DEVICES]


@pytest.mark.slow
def test_random_frames_break_nothing(monkeypatch):
    monkeypatch.setenv("PYTHONMALLOC", "malloc")
    for n_sent, n_dropped, n_resets in run_in_process(fuzz_all, N_FRAMES):
        assert n_sent > N_FRAMES // 50
        assert n_dropped > N_FRAMES // 500
        assert n_resets > N_FRAMES // 5000
