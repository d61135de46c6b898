"""A master and simulated patches on two wires: an arm whose seam lies between the buses."""

from skinbus.can.event import Event, EventKind
from skinbus.can.virtual_buses import VirtualBuses
from tests.files import put
from tests.master.rig import MS, Rig, since
from tests.two_buses import two_buses

LEFT, RIGHT = 0, 1

ARM = two_buses(("right", 1, 80.0), ("left", 1, 28.0), second="bitrate = 500_000")

SCENE = """
[scene]
title = "presses on the left, the right and the seam between"
arm = "{arm}"
duration_s = 1000.0
"""

TOUCH = """
[[touch]]
link = "plate"
s_mm = {s_mm}
a_mm = {a_mm}
shape = "disc"
diameter_mm = 10.0
force_n = 6.0
start_s = 0.0
end_s = 1000.0
"""

ON_LEFT, ON_RIGHT, ON_SEAM = (20.0, -8.0), (90.0, 8.0), (54.0, 1.0)


def write_scene(folder, touches, arm=ARM):
    """Write the arm and a scene with touches at (s, a) mm; the path of the scene."""
    scene = SCENE.format(arm=put(folder, "arm.toml", arm))
    scene += "".join(TOUCH.format(s_mm=s, a_mm=a) for s, a in touches)
    return put(folder, "scene.toml", scene)


CONTACT_IDS = range(0x681, 0x691)


def contacts_in(frames):
    """The contact TPDOs of frames, to the byte."""
    return [(frame.can_id, frame.data) for frame in frames if frame.can_id in CONTACT_IDS]


class BusesRig(Rig):
    """Everything that a test looks at; frames by bus."""

    def __init__(self, scene_file, **settings):
        super().__init__(scene_file, lambda world: world, **settings)

    def connect(self):
        self.wires = VirtualBuses([bus.bitrate for bus in self.scene.arm.buses])
        self.patch_ports = self.wires.attach(self.world)
        self.ports = self.wires.attach(self.master, on_event=self.events.append)
        self.frames = [[] for _ in self.wires.wires]
        for wire, frames in zip(self.wires.wires, self.frames, strict=True):
            wire.tap(frames.append)

    @property
    def now_ns(self):
        return self.wires.clock.now_ns()

    def run(self, ms):
        """Let bus time pass; return the cycles, the events and the frames by bus of that time."""
        until_ns = self.now_ns + round(ms * MS)
        kept = self.reports, self.events, *self.frames
        reports, events, *frames = since(lambda: self.wires.run(until_ns), *kept)
        return reports, events, frames

    def lose(self, bus):
        """Pull the master's plug out of a bus."""
        self.wires.wires[bus].detach(self.ports[bus])
        self.master.bus_news(self.now_ns, Event(t_ns=self.now_ns, kind=EventKind.BUS_LOST, bus=bus))

    def plug_in(self, bus):
        """Plug it in again."""
        self.wires.wires[bus].restart(self.ports[bus])
        self.master.bus_news(self.now_ns, Event(t_ns=self.now_ns, kind=EventKind.BUS_BACK, bus=bus))

    def get(self, bus, index, sub=0):
        """An object of the master's node on a bus."""
        return self.master.branches[bus].device.get(index, sub)
