"""A master that is killed and started again on a bus that goes on."""

from skinbus.master import Master
from skinbus.master.memory import Memory
from tests.master.rig import Rig

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


class Restarts(Rig):
    """The wire, the patches of a scene, and one master after the other."""

    def __init__(self, scene, **settings):
        super().__init__(scene, **settings)
        self.settings = settings

    def start(self, tables, age_s):
        """Start a master, which takes up what another one has learned; return what came of that."""
        master = Master(self.scene.arm, on_cycle=self.take, **self.settings)
        found = Memory(master.cycle).resume(tables, age_s)
        if self.master:
            self.kill()
        self.master, self.master_port = master, self.wire.attach(master, on_event=self.events.append)
        return found

    def kill(self):
        """End the master without a word; return what it would have kept last."""
        memory, self.master = Memory(self.master.cycle), None
        self.wire.detach(self.master_port)
        return memory.as_tables(memory.snapshot())
