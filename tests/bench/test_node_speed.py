"""What a device costs: per SYNC, per SDO request, per event, per reset."""

import numpy as np
import pytest

from skinbus.can.frame import Frame
from skinbus.node import Device, image_size
from skinbus.objects.eds import load_eds

pytestmark = pytest.mark.slow

N_PATCHES = 126
START = Frame(0, b"\x01\x00")


def patch(node_id=5, image=None):
    device = Device(load_eds("skin-patch", node_id), node_id, image=image)
    device.step(0)
    device.step(0, [START])
    return device


def test_sync_of_126_patches(benchmark):
    """Four TPDOs each; divide by 126 for one device."""
    size = image_size(load_eds("skin-patch", 1))
    memory = np.zeros((N_PATCHES, size), np.uint8)
    devices = [patch(k + 1, memory[k]) for k in range(N_PATCHES)]
    sync = (Frame(0x80),)

    def run():
        return [device.step(1, sync) for device in devices]

    steps = benchmark(run)
    assert sum(len(step.frames) for step in steps) == 4 * N_PATCHES


def test_expedited_read(benchmark):
    device = patch()
    request = (Frame(0x605, bytes.fromhex("4018100400000000")),)
    assert benchmark(lambda: device.step(1, request)).frames[0].can_id == 0x585


def test_expedited_write_that_configures_a_pdo(benchmark):
    device = patch()
    request = (Frame(0x605, bytes.fromhex("2F00180201000000")),)
    assert benchmark(lambda: device.step(1, request)).frames[0].data[0] == 0x60


def test_seventeen_events_of_the_master(benchmark):
    device = Device(load_eds("skin-master", 127), 127)
    device.step(0)
    device.set(0x1006, 0, 0)
    device.step(0, [START])

    def run():
        for number in range(1, 18):
            device.transmit_tpdo(number)
        return device.step(1)

    assert len(benchmark(run).frames) == 17


@pytest.mark.parametrize("moves", [False, True])
def test_quiet_patch_that_sends_on_change(benchmark, moves):
    device = patch()
    for number in (1, 2, 3, 4):
        device.set(0x17FF + number, 2, 254)
    device.set(0x6423, 0, 1)
    view = device.image_view(0x6401, 1, 16)

    def run():
        view[:] += moves
        return device.step(1)

    run()
    assert len(benchmark(run).frames) == 4 * moves


def test_reset_node(benchmark):
    device = patch()
    reset = (Frame(0, b"\x81\x00"),)
    assert benchmark(lambda: device.step(1, reset)).frames
