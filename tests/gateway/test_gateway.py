"""A skin that is not CANopen as patches of an arm: what it senses is published, what it loses is said."""

import pytest

from skinbus.can.virtual_buses import VirtualBuses
from skinbus.config.system import ods_of
from skinbus.gateway.frame_format import load_format
from skinbus.gateway.gateway import Gateway
from skinbus.master import Master
from tests.gateway.doubles import Double, write_scene

MS = 1_000_000
PRESS = """[[touch]]
link = "plate"
s_mm = 52.0
a_mm = 1.0
force_n = 4.0
start_s = 1.5
end_s = 900.0
"""


class Rig:
    """A master, a gateway and the boards of a skin on two wires."""

    def __init__(self, folder, name, addresses, columns, rows, touches=PRESS):
        self.found = load_format(name)
        self.scene = write_scene(folder, addresses, columns, rows, touches=touches)
        arm = self.scene.arm
        self.boards = Double(self.found, arm, self.scene)
        self.gateway = Gateway(self.found, arm, ods_of(arm))
        self.reports, self.events, self.said = [], [], []
        self.master = Master(arm, on_cycle=self.reports.append)
        self.wires = VirtualBuses([arm.bus.bitrate, self.found.bitrate])
        self.wires.attach(self.gateway, on_event=self.said.append)
        self.wires.wires[0].attach(self.master, on_event=self.events.append)
        self.wires.wires[1].attach(self.boards)

    def run(self, ms):
        """Let time pass; return the cycles and the events of the master and of the gateway in that time."""
        start = len(self.reports), len(self.events), len(self.said)
        self.wires.run(self.wires.clock.now_ns() + round(ms * MS))
        return self.reports[start[0] :], self.events[start[1] :], self.said[start[2] :]


MTB4 = ("icub-mtb4", ["2.0", "2.1", "3.7"], 5, 2)
XELA = ("xela-uskin", ["1", "2", "3"], 4, 4)


@pytest.mark.parametrize("skin", [MTB4, XELA], ids=["mtb4", "xela"])
def test_a_touch_of_the_skin_is_a_contact_of_the_master(tmp_path, skin):
    rig = Rig(tmp_path, *skin)
    rig.run(1400)
    cycles, _, _ = rig.run(1000)
    last = cycles[-1]
    assert len(last.contacts) == 1
    print(last.contacts, rig.said, rig.events)
