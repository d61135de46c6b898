"""Devices on the in-process wire and a command's core, run until it asks its host to stop."""

from skinbus.can.event import EventKind
from skinbus.can.virtual_bus import VirtualBus
from skinbus.config.system import load_arm
from skinbus.master import Master
from skinbus.node import Device
from skinbus.objects.eds import load_eds

MS = 1_000_000
PATIENCE_MS = 60_000


def patch(node_id, eds="skin-patch", storage=None, **settings):
    """A patch as it leaves the factory, with a memory of its own."""
    return Device(
        load_eds(eds, node_id % 128 or 1, **settings), node_id, storage={} if storage is None else storage
    )


class Bench:
    """Cores on one wire."""

    def __init__(self, *cores):
        self.wire = VirtualBus()
        self.frames = []
        self.wire.tap(self.frames.append)
        self.ports = [self.wire.attach(core) for core in cores]
        self.pass_ms(10)

    def start(self, **settings):
        """Start a master of the arm "pad" at 20 Hz, whose events and cycles are kept; return it."""
        self.events, self.reports = [], []
        usual = {"level": "kmeans", "on_cycle": self.reports.append}
        master = Master(load_arm("pad").with_rate(20.0), **usual | settings)
        self.wire.attach(master, on_event=self.events.append)
        return master

    def pass_ms(self, ms):
        self.wire.run(self.wire.now_ns + round(ms * MS))

    def run(self, core):
        """Run a core until it is done; return its events."""
        events = []
        port = self.wire.attach(core, on_event=events.append)
        for _ in range(PATIENCE_MS // 10):
            self.pass_ms(10)
            if any(event.kind == EventKind.STOP for event in events):
                self.wire.detach(port)
                return events
        raise AssertionError(f"{core} did not end within {PATIENCE_MS} ms")
