"""Patches that boot and then misbehave: late, torn, mute, doubled; their readings name their SYNC."""

import struct

import numpy as np

from skinbus.can.core import Core, Step
from skinbus.can.frame import Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.master import Master
from skinbus.objects import cia
from skinbus.sim import World, load_scene
from tests.master.misbehaving import Delayed

MS = 1_000_000
TPDO_OF = {base: number for number, base in enumerate(cia.TPDO_BASES, 1)}


class Misbehaving(Delayed):
    """A world whose readings are all equal to the number of the SYNC that they answer.

    ``delay(node_id, tpdo)`` returns by how many ns a frame is late, None for one that is never sent;
    ``doubled`` are node-IDs under which a second board answers, ``second_ns`` later.
    """

    def __init__(self, world):
        super().__init__(world)
        self.delay = lambda node_id, tpdo: 0
        self.doubled = set()
        self.second_ns = 200_000
        self.n_syncs = 0
        self.own = 0
        """Number of the newest SYNC of the master under test; others carry a counter."""

    def step(self, now_ns, frames):
        for frame in frames:
            if frame.can_id == cia.SYNC_ID:
                self.n_syncs += 1
                if not frame.data:
                    self.own = self.n_syncs
        return super().step(now_ns, frames)

    def later(self, now_ns, frame):
        tpdo, node_id = TPDO_OF.get(frame.can_id & ~0x7F), frame.can_id & 0x7F
        if tpdo is None:
            return [(now_ns, frame)]
        own, other = (
            frame._replace(data=struct.pack("<4h", *[value] * 4)) for value in (self.n_syncs, -self.n_syncs)
        )
        late_ns = self.delay(node_id, tpdo)
        sent = [] if late_ns is None else [(now_ns + late_ns, own)]
        return sent + [(now_ns + self.second_ns, other)] * (node_id in self.doubled)


class Foreign(Core):
    """Another master: SYNC with a counter from ``begin_ns`` to ``end_ns``."""

    def __init__(self, rate_hz, begin_ns, end_ns):
        self.period_ns = round(1e9 / rate_hz)
        self.next_ns, self.end_ns = begin_ns, end_ns

    def step(self, now_ns, frames):
        if now_ns < self.next_ns:
            return Step((), (), self.next_ns)
        self.next_ns += self.period_ns
        if self.next_ns >= self.end_ns:
            self.next_ns = 2**62
        return Step((Frame(cia.SYNC_ID, bytes([1])),), (), self.next_ns)


class MisbehavingRig:
    """A master, such patches, and what was used of them in each cycle."""

    def __init__(self, scene_name):
        scene = load_scene(scene_name)
        self.arm = scene.arm
        self.patches = Misbehaving(World(scene))
        self.events = []
        self.cycles = []
        """Time of each cycle (ns), which patches were fresh (n_patches,), and latency (ns)."""
        self.violations = []
        self.master = Master(self.arm, level="kmeans", on_cycle=self._check)  # contacts are not looked at
        self.period_ns = self.master.period_ns
        self.wire = VirtualBus(self.arm.bus.bitrate)
        self.wire.attach(self.patches)
        self.wire.attach(self.master, on_event=self.events.append)

    def run(self, ms):
        """Let bus time pass; return the share of its cycles in which each patch was fresh, (n_patches,)."""
        n = len(self.cycles)
        self.wire.run(self.wire.clock.now_ns() + round(ms * MS))
        return np.mean([fresh for _, fresh, _ in self.cycles[n:]], axis=0)

    def kinds(self, node_id=None):
        """Kinds of events so far, of one patch if one is named."""
        return [event.kind for event in self.events if node_id in (None, event.node_id)]

    def _check(self, report):
        fresh = self.master.table.last_fresh >= report.t_ns
        counts = self.master.gather.counts
        for p in np.flatnonzero(fresh):
            wrong = counts[self.arm.tactels_of(p)] != self.patches.own
            if wrong.any():
                self.violations.append((report.t_ns, int(p), int(wrong.sum())))
        self.cycles.append((report.t_ns, fresh, report.latency_ns))
