"""The pad on a bus, a person with a probe, and the dialogue that guides through presses."""

import re

import numpy as np

from skinbus.can.virtual_bus import VirtualBus
from skinbus.config.system import load_arm
from skinbus.master.commissioning.press_guide import PressGuide
from skinbus.master.commissioning.unplaced_boards import QuietMaster
from skinbus.sim import World
from skinbus.sim.effects.readings import GainSpread, Noise, Offset
from tests.master.commissioning.person import pressed_scene

SEED = 20261126
MS = 1_000_000
FORCE_N = 5.0
PLACE_SD = 0.2e-3
"""m, of a probe in a jig."""
ASKED = re.compile(r"node (\d+): press at s (-?[\d.]+) mm, a (-?[\d.]+) mm")


class Bench:
    """The pad on a bus, a person with a probe, and the dialogue."""

    def __init__(self, seed=SEED, **settings):
        print(f"seed {seed}")
        self.arm = load_arm("pad")
        self.scene = pressed_scene(self.arm, [Noise(), Offset(sigma_pa=300.0), GainSpread(sigma=0.05)])
        self.rng = np.random.default_rng(seed)
        self.wire = VirtualBus(self.arm.bus.bitrate)
        self.wire.attach(World(self.scene))
        self.guide = PressGuide(self.arm, FORCE_N, **settings)
        self.lines, self.answers = [], []
        self.wire.attach(QuietMaster(self.arm, self._cycle))
        self.wait(2000)

    def _cycle(self, t_ns, pressures):
        answers, self.answers = self.answers, []
        self.lines += self.guide.step(t_ns, pressures, answers)

    def wait(self, ms):
        """Let time pass; return the lines that are shown meanwhile."""
        n = len(self.lines)
        self.wire.run(self.wire.now_ns + round(ms * MS))
        return self.lines[n:]

    def type(self, word):
        self.answers.append(word)
        return self.wait(50)

    def press(self, s, a, *, force=FORCE_N, ms=600):
        """Press a place (m)."""
        s, a = np.array([s, a]) + PLACE_SD * self.rng.standard_normal(2)
        self.scene.plan.touches = [(0, s, a, force)]
        lines = self.wait(ms)
        self.scene.plan.touches = []
        return lines + self.wait(250)

    def asked(self):
        """Where the newest line asks to press, m."""
        _, s, a = ASKED.search(self.lines[-1]).groups()
        return 1e-3 * float(s), 1e-3 * float(a)

    def obey(self):
        return self.press(*self.asked())
