"""A master that is killed and started again on a bus that goes on."""

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.virtual_bus import VirtualBus
from skinbus.master import Master
from skinbus.master.memory import Memory
from skinbus.sim import World, load_scene

MS = 1_000_000

SCENE = """
[scene]
title = "two fingertips that stay, on a board whose zeros are off"
arm = "pad"
duration_s = 90000.0
seed = 5

[[touch]]
link = "plate"
shape = "disc"
diameter_mm = 10.0
s_mm = 12.0
a_mm = -14.0
force_n = [[2.0, 0.0], [2.2, 5.0], [89000.0, 5.0]]

[[touch]]
link = "plate"
shape = "disc"
diameter_mm = 10.0
s_mm = 40.0
a_mm = 14.0
force_n = [[2.5, 0.0], [2.7, 3.0], [89000.0, 3.0]]

[effect.noise]
[effect.offset]
sigma_pa = 300.0
"""


class Slot(Core):
    """Where the master of the moment is; without one nothing is heard."""

    def __init__(self):
        self.master = None

    @property
    def cob_ids(self):
        return self.master.cob_ids if self.master else frozenset()

    def cob_ids_on(self, bus):
        return self.master.cob_ids_on(bus) if self.master else frozenset()

    def data_ids_on(self, bus):
        return self.master.data_ids_on(bus) if self.master else frozenset()

    @property
    def n_owed(self):
        return self.master.n_owed if self.master else 0

    def take(self, now_ns, batch):
        if self.master:
            self.master.take(now_ns, batch)

    def bus_news(self, now_ns, event):
        if self.master:
            self.master.bus_news(now_ns, event)

    def not_sent(self, now_ns, frames):
        if self.master:
            self.master.not_sent(now_ns, frames)

    def step(self, now_ns, frames):
        return self.master.step(now_ns, frames) if self.master else Step((), (), NEVER)


class Restarts:
    """The wire, the patches of a scene, and one master after the other."""

    def __init__(self, scene, **settings):
        self.scene = load_scene(scene)
        self.settings = settings
        self.slot, self.reports, self.events = Slot(), [], []
        self.world = World(self.scene)
        self.wire = VirtualBus(self.scene.arm.bus.bitrate)
        self.wire.attach(self.world)
        self._port = None

    def run(self, ms):
        """Let bus time pass; return the cycles of that time."""
        n = len(self.reports)
        self.wire.run(self.wire.clock.now_ns() + round(ms * MS))
        return self.reports[n:]

    def start(self, tables=None, age_s=0.0):
        """Start a master, which takes up what another one has learned; return what came of that."""
        master = Master(self.scene.arm, on_cycle=self.reports.append, **self.settings)
        found = Memory(master.cycle).resume(tables, age_s) if tables is not None else None
        self.slot.master = master
        if self._port is None:  # the wire asks once what carries readings
            self._port = self.wire.attach(self.slot, on_event=self.events.append)
        self.wire.wake(self._port)
        return found

    def kill(self):
        """End the master without a word; return what it would have kept last."""
        memory = Memory(self.slot.master.cycle)
        self.slot.master = None
        return memory.as_tables(memory.snapshot())
