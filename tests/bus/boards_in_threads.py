"""A master and two boards on UDP multicast, each in a thread, in real time."""

import threading
import time

from skinbus.bus.loop import run_core
from skinbus.bus.pythoncan import PythonCanBus
from skinbus.master import Master
from skinbus.sim import World, load_scene
from tests.cli.patience import PATIENCE_S

GOOD, BAD = 1, 2
"""Node-IDs: the second board misbehaves."""

ARM = """
[arm]
name = "two"
rate_hz = {rate_hz}

[[link]]
name = "plate"
surface = "plane"
length_mm = 120.0
width_mm = 60.0

[[patch]]
node_id = 1
link = "plate"
s_mm = 30.0

[[patch]]
node_id = 2
link = "plate"
s_mm = 90.0
{settings}
"""
SCENE = """
[scene]
arm = "arm.toml"
duration_s = 1000.0
"""


def write_scene(folder, rate_hz, settings=""):
    """Write the arm, with more settings of the second board; return the file of the scene."""
    (folder / "arm.toml").write_text(ARM.format(rate_hz=rate_hz, settings=settings))
    (folder / "scene.toml").write_text(SCENE)
    return folder / "scene.toml"


class Threads:
    """Cores on a multicast group, each in a thread, from ``attach`` to the end of ``with``."""

    def __init__(self, group):
        self.group = group
        self.errors = []
        self._stop = threading.Event()
        self._threads = []

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self._stop.set()
        for thread in self._threads:
            thread.join()
        assert not self.errors, self.errors

    def attach(self, core, on_event=None):
        """Run another core on the interface until the end."""
        self._threads.append(threading.Thread(target=self._run, args=(core, on_event)))
        self._threads[-1].start()

    def wait_for(self, happened, what):
        """Wait until something is so."""
        end_s = time.monotonic() + PATIENCE_S
        while not happened():
            assert not self.errors, self.errors
            assert time.monotonic() < end_s, f"waited {PATIENCE_S} s for {what}"
            time.sleep(0.01)

    def _run(self, core, on_event):
        try:
            bus = lambda: PythonCanBus("udp_multicast", self.group)  # noqa: E731
            run_core(core, bus, stop=self._stop, on_event=on_event)
        except BaseException as error:
            self.errors.append(error)
            raise


class Skin(Threads):
    """A master and two boards, which ``boards`` makes of the world; used with ``with``."""

    def __init__(self, scene_file, group, boards):
        super().__init__(group)
        scene = load_scene(scene_file)
        self.arm = scene.arm
        self.boards = boards(World(scene))
        self.events, self.reports = [], []
        self.master = Master(scene.arm, on_cycle=self.check)
        self.period_ns = self.master.period_ns

    def __enter__(self):
        self.attach(self.boards)
        self.attach(self.master, self.events.append)
        self.wait_for(lambda: self.reports and self.reports[-1].fresh.all(), "fresh readings")
        return self

    def check(self, report):
        """Take what the master publishes of a cycle."""
        self.reports.append(report)
