"""The master in a program: patches run while it is open and are stopped when it is left."""

import pytest

import skinbus
from skinbus.bus.pythoncan import PythonCanBus
from skinbus.errors import BusError
from skinbus.estimate import DEFAULT_LEVEL
from skinbus.objects.cia import NmtState
from skinbus.sim import World, load_scene
from tests.cli.commands.on_bus import OwnBus
from tests.cli.patience import PATIENCE_S
from tests.skin.scenes import write


@pytest.mark.slow
def test_contacts_come_another_master_is_refused_and_leaving_stops_the_patches(tmp_path):
    own_bus, world = OwnBus(), World(load_scene(write(tmp_path)), repeat=True)
    place = {"interface": "virtual", "channel": own_bus.channel}
    with own_bus.with_cores(world):
        with skinbus.open("pad", **place) as skin:
            # of a lower level where a busy machine leaves no time for it
            cycle = next(cycle for cycle in skin if cycle.contacts and cycle.level == DEFAULT_LEVEL)
            assert cycle.contacts[0].link == "plate"
            assert 0.0 <= cycle.contacts[0].age_s < PATIENCE_S
            assert world.devices[0].nmt_state is NmtState.OPERATIONAL
            skin.zero()
            with pytest.raises(BusError, match="master"):
                skinbus.open("pad", **place)
        heard = PythonCanBus("virtual", own_bus.channel)
        while world.devices[0].nmt_state is not NmtState.PRE_OPERATIONAL:
            heard.receive(0.01)
        heard.close()
