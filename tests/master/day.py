"""A day of a master on the virtual clock: the bus and boards come and go, the clock on the wall steps.

``python -m tests.master.day 24`` runs so many hours at the lowest rate, a SYNC a second; a number after that
is the seed. Prints the size of the log and how memory has grown.
"""

import gc
import random
import sys
import tempfile
from collections import Counter
from pathlib import Path

from skinbus.can.event import Event, EventKind
from skinbus.cli.event_log import EventLog, wall_stamp
from skinbus.cli.host import NOT_FOR_PEOPLE
from skinbus.config.arm_file import find_arm
from tests.master.rig import Rig

MAX_LOG = 1_000_000
"""Bytes a day."""
STEP_S = 30.0
"""Between two changes."""

SCENE = """
[scene]
arm = "{arm}"
duration_s = 1e6
title = "a finger that comes and goes"
[[touch]]
link = "plate"
shape = "disc"
diameter_mm = 10.0
s_mm = 25.0
a_mm = 0.0
force_n = [[100.0, 0.0], [101.0, 5.0], [900000.0, 5.0]]
[effect.noise]
"""


class Day:
    """What happens, and what the log says of it."""

    def __init__(self, folder: Path, seed: int) -> None:
        arm = folder / "arm.toml"
        arm.write_text(find_arm("pad").read_text().replace("rate_hz = 100.0", "rate_hz = 1.0"))
        (folder / "scene.toml").write_text(SCENE.format(arm=arm))
        self.rig = Rig(folder / "scene.toml")
        self.rng = random.Random(seed)
        self.wall_step_s = 0.0
        self.lines: list[str] = []
        self.kinds: Counter[EventKind] = Counter()
        self.log = EventLog(
            self.lines.append,
            now=lambda: 1e-9 * self.rig.wire.clock.now_ns(),
            stamp=lambda t: wall_stamp(t + self.wall_step_s),
        )
        self.is_lost = False

    def event(self, kind: EventKind) -> None:
        """Have the bus report something, to the master and to the log."""
        event = Event(t_ns=self.rig.wire.clock.now_ns(), kind=kind)
        self.rig.master.bus_news(event.t_ns, event)
        self.rig.events.append(event)

    def change(self) -> None:
        """Let one thing come or go."""
        match self.rng.randrange(4):
            case 0:
                self.is_lost = not self.is_lost
                self.rig.patches.is_cut = self.is_lost
                self.event(EventKind.BUS_LOST if self.is_lost else EventKind.BUS_BACK)
            case 1:
                self.rig.patches.unplugged ^= {1}
            case 2:
                self.wall_step_s = self.rng.choice([-3600.0, 0.0, 3600.0])

    def mend(self) -> None:
        """Let everything be there again."""
        if self.is_lost:
            self.is_lost = self.rig.patches.is_cut = False
            self.event(EventKind.BUS_BACK)
        self.rig.patches.unplugged.clear()

    def run(self, seconds: float) -> None:
        """Let time pass, and have the log show what is due."""
        self.rig.run(1e3 * seconds)
        for event in self.rig.events:
            self.kinds[event.kind] += 1
            if event.kind not in NOT_FOR_PEOPLE:
                self.log.take(event)
        self.log.show()
        for kept in (self.rig.events, self.rig.reports, self.rig.frames):
            kept.clear()


def live(hours: float, seed: int, folder: Path) -> tuple[Day, int]:
    """Return the day, and how many objects more there are at its end than after a quarter."""
    day = Day(folder, seed)
    n_steps = round(3600.0 * hours / STEP_S)
    n_objects = 0
    for k in range(n_steps):
        day.change()
        day.run(STEP_S)
        if k == n_steps // 4:
            gc.collect()
            n_objects = len(gc.get_objects()) - len(day.lines)
    day.mend()
    day.run(4 * STEP_S)
    day.log.show(all_of_it=True)
    gc.collect()
    return day, len(gc.get_objects()) - len(day.lines) - n_objects


if __name__ == "__main__":
    n_hours = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    first_seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    with tempfile.TemporaryDirectory() as where:
        lived, grown = live(n_hours, first_seed, Path(where))
    size = sum(len(line) + 1 for line in lived.lines)
    print(f"{n_hours:g} h: log of {size / 1e3:.0f} kB, {len(lived.lines)} lines; {grown} more objects")
    for kind, n in lived.kinds.most_common():
        print(f"  {kind:20} {n}")
