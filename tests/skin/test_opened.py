"""The master in a program: patches run while it is open and are stopped when it is left."""

import secrets
from contextlib import contextmanager

import pytest

import skinbus
from skinbus.bus.core_thread import CoreThread
from skinbus.bus.pythoncan import PythonCanBus
from skinbus.errors import BusError
from skinbus.estimate import DEFAULT_LEVEL
from skinbus.objects.cia import NmtState
from skinbus.sim import World, load_scene
from tests.cli.patience import PATIENCE_S
from tests.skin.scenes import write


@contextmanager
def patches(scene, channel):
    """Patches on a bus of this process; their world."""
    world = World(load_scene(scene), repeat=True)
    thread = CoreThread(world, lambda: PythonCanBus("virtual", channel))
    thread.start()
    try:
        yield world
    finally:
        thread.stop()


@pytest.fixture
def channel():
    return f"skin-{secrets.token_hex(4)}"


@pytest.fixture
def scene(tmp_path):
    return write(tmp_path)


@pytest.mark.slow
def test_contacts_come_and_leaving_stops_the_patches(scene, channel):
    with patches(scene, channel) as world:
        with skinbus.open("pad", interface="virtual", channel=channel) as skin:
            # of a lower level where a busy machine leaves no time for it
            cycle = next(cycle for cycle in skin if cycle.contacts and cycle.level == DEFAULT_LEVEL)
            assert cycle.contacts[0].link == "plate"
            assert 0.0 <= cycle.contacts[0].age_s < PATIENCE_S
            assert world.devices[0].nmt_state is NmtState.OPERATIONAL
            skin.zero()
        heard = PythonCanBus("virtual", channel)
        while world.devices[0].nmt_state is not NmtState.PRE_OPERATIONAL:
            heard.receive(0.01)
        heard.close()


@pytest.mark.slow
def test_two_masters_are_refused(scene, channel):
    with patches(scene, channel), skinbus.open("pad", interface="virtual", channel=channel) as skin:
        next(skin)
        with pytest.raises(BusError, match="master"):
            skinbus.open("pad", interface="virtual", channel=channel)
