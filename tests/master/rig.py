"""A master and simulated patches on the in-process wire, with hands to make patches fall silent."""

import numpy as np

from skinbus.can.core import Step
from skinbus.can.virtual_bus import VirtualBus
from skinbus.master import Master
from skinbus.sim import World, load_scene
from tests.bus.cores import Talker
from tests.master.misbehaving import Wrapped

MS = 1_000_000
READINGS = {0x180, 0x280, 0x380, 0x480}
"""COB-IDs of TPDO 1 to 4 of node 0."""


def since(run, *kept):
    """Run; return what has come to each of some lists meanwhile."""
    before = [len(each) for each in kept]
    run()
    return [each[n:] for each, n in zip(kept, before, strict=True)]


class Patches(Wrapped):
    """A world whose patches can be unplugged: what they send is lost, what is sent to them unheard.

    ``is_cut`` is the whole bus cut through between master and patches, broadcasts and all;
    ``added_counts`` are added to all readings of a node; ``changes`` of a node take the number of a TPDO
    (from 0) and its four readings, and return what it sends instead.
    """

    def __init__(self, world):
        super().__init__(world)
        self.unplugged = set()
        self.is_cut = False
        self.added_counts = {}
        self.changes = {}

    def step(self, now_ns, frames):
        if self.is_cut:
            return Step((), (), super().step(now_ns, ()).wake_ns)
        step = super().step(
            now_ns, [f for f in frames if f.can_id & 0x7F not in self.unplugged or f.can_id < 0x100]
        )
        return step._replace(
            frames=[self.shifted(f) for f in step.frames if f.can_id & 0x7F not in self.unplugged]
        )

    def shifted(self, frame):
        """A frame, with what is done to its readings if it carries any."""
        node_id = frame.can_id & 0x7F
        added, change = self.added_counts.get(node_id), self.changes.get(node_id)
        if not (added or change) or frame.can_id & ~0x7F not in READINGS:
            return frame
        counts = np.frombuffer(frame.data, "<i2").astype(int) + (added or 0)
        if change:
            counts = change((frame.can_id - 0x180) >> 8, counts)
        return frame._replace(data=np.clip(counts, -0x8000, 0x7FFF).astype("<i2").tobytes())


class Rig:
    """Everything that a test looks at; ``boards`` wraps the world. ``arm`` replaces that of the scene."""

    def __init__(self, scene_name, boards=Patches, arm=None, **settings):
        self.scene = load_scene(scene_name, arm=arm)
        self.world = World(self.scene)
        self.patches = boards(self.world)
        self.reports, self.events, self.frames = [], [], []
        self.master = Master(self.scene.arm, on_cycle=self.take, **settings)
        self.connect()

    def connect(self):
        bus = self.scene.arm.bus
        self.wire = VirtualBus(bus.bitrate, data_bitrate=bus.data_bitrate)
        self.port = self.wire.attach(self.patches)
        self.master_port = self.wire.attach(self.master, on_event=self.events.append)
        self.wire.tap(self.frames.append)
        self.stranger = Talker((), frozenset())
        self._stranger_port = self.wire.attach(self.stranger)

    def take(self, report):
        self.reports.append(report)

    def fresh(self, ms):
        """Let bus time pass; return the share of its cycles in which each patch was fresh, (n_patches,)."""
        return np.mean([report.fresh for report in self.run(ms)[0]], axis=0)

    def run(self, ms):
        """Let bus time pass; return the cycles, events and frames of that time."""
        until_ns = self.wire.clock.now_ns() + round(ms * MS)
        return since(lambda: self.wire.run(until_ns), self.reports, self.events, self.frames)

    def say(self, *frames):
        """Let somebody else send frames at once."""
        self.stranger.plan += [(0, frame) for frame in frames]
        self.wire.wake(self._stranger_port)

    def device(self, node_id):
        return self.world.devices[self.scene.arm.patch_at(node_id)]

    def state(self, node_id):
        """The patch's state as the master's object dictionary shows it."""
        return self.master.device.get(0x2300, node_id)
