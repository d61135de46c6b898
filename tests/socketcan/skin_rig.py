"""A pressed skin on a real interface: simulated patches and a master, each in a thread, and an observer."""

import struct
import threading
import time
from functools import partial

from skinbus.bus.loop import Loop
from skinbus.bus.socketcan import SocketCanBus
from skinbus.config.system import ods_of
from skinbus.master import Master
from skinbus.objects.contacts import ContactState
from skinbus.sim import World, load_scene
from tests.files import put

PRESS = """
[scene]
title = "a press that does not end"
arm = "{arm}"
duration_s = 100000.0

[[touch]]
link = "{link}"
s_mm = 28.0
a_mm = 4.0
shape = "disc"
diameter_mm = 10.0
force_n = 5.0
start_s = 0.0
end_s = 100000.0
"""

PATIENCE_S = 120.0
"""Nothing waits that long when all is well."""

SYNC, PDO, CONTACT = 0x080, 0x181, 0x681
"""Identifiers: SYNC, first readings of patch 1, first contact."""

FORCE = struct.Struct("<6xH")


class Skin:
    """A master and its patches on interfaces of this kernel; used with ``with``."""

    def __init__(self, tmp_path, *channels, sim_channel=None, arm="pad"):
        scene = load_scene(put(tmp_path, "press.toml", PRESS.format(arm=arm, link="plate")))
        self.channel = channels[0]
        self.events = []
        self.reports = []
        self.freeze = threading.Event()
        self.frozen = threading.Event()
        self.world = World(scene, ods_of(scene.arm))
        self.master = Master(scene.arm, on_cycle=self._cycle)
        self._stop = threading.Event()
        self._threads = [
            threading.Thread(
                target=self._run, args=(self.world, [sim_channel] if sim_channel else channels, None, None)
            ),
            threading.Thread(target=self._run, args=(self.master, channels, self.events.append, self._step)),
        ]
        self.errors = []
        self.n_reports = 0

    def __enter__(self):
        self.observer = SocketCanBus(self.channel)
        for thread in self._threads:
            thread.start()
        self.wait_for(lambda: self.pressed(0.0), "the first contact")
        return self

    def __exit__(self, *exc):
        self.freeze.clear()
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self.observer.close()
        assert not self.errors, self.errors

    def wait_for(self, happened, what, timeout_s=PATIENCE_S):
        """Wait until something is so; the time it took (s)."""
        begin_s = time.monotonic()
        while not happened():
            assert time.monotonic() - begin_s < timeout_s, (
                f"waited {timeout_s} s for {what}; {self.events[-5:]}"
            )
            assert not self.errors, self.errors
            time.sleep(0.005)
        return time.monotonic() - begin_s

    def wait_for_event(self, kind, n=1):
        """Wait until the master's side has told of a kind of event so often."""
        self.wait_for(lambda: self.kinds().count(kind) >= n, kind.name)

    def wait_for_zero(self, index, sub):
        """Wait until an object of the master is 0."""
        self.wait_for(lambda: not self.master.device.get(index, sub), f"0x{index:X}:{sub:02X} to be 0")

    def pressed(self, since_s):
        """Whether a cycle that began after this time (monotonic, s) found the press."""
        return any(len(report.contacts) for report in self.reports if report.t_ns > since_s * 1e9)

    def kinds(self):
        """Kinds of all events of the master's side."""
        return [event.kind for event in self.events]

    def _cycle(self, report):
        self.n_reports += 1
        self.reports.append(report)
        del self.reports[:-20]

    def _step(self, step):
        if self.freeze.is_set():
            self.frozen.set()
            while self.freeze.is_set() and not self._stop.is_set():
                time.sleep(0.01)
            self.frozen.clear()

    def _run(self, core, channels, on_event, on_step):
        opens = [partial(SocketCanBus, channel) for channel in channels]
        try:
            Loop(core, opens, stop=self._stop, on_event=on_event, on_step=on_step).run()
        except BaseException as error:
            self.errors.append(error)
            raise


def is_reading(frame):
    """Whether a frame is a TPDO 1-4 of a patch, not of the master."""
    return frame.can_id & 0x780 in (0x180, 0x280, 0x380, 0x480) and frame.can_id & 0x7F not in (0, 0x7F)


def assert_nothing_stale(frames):
    """Every contact with force comes after readings of its cycle, or coasts and was seen in these frames.

    On a busy machine a cycle may close in the moment of the next SYNC, and its contacts follow that.
    """
    n_before = n_readings = 0
    seen = set()
    for frame in frames:
        if frame.can_id == SYNC:
            n_before, n_readings = n_readings, 0
        elif is_reading(frame):
            n_readings += 1
        elif frame.can_id == CONTACT and FORCE.unpack(frame.data)[0]:
            identity, state = frame.data[0], frame.data[1] >> 4
            if state == ContactState.COAST:
                assert identity in seen, "a contact from before"
            else:
                assert n_readings or n_before, "a contact without readings of its cycle"
                seen.add(identity)
