"""Patches that boot and then misbehave: late, torn, mute, doubled; their readings name their SYNC."""

import struct

import numpy as np

from skinbus.can.frame import Frame
from skinbus.config.system import load_arm
from skinbus.objects import cia
from tests.master.misbehaving import Delayed
from tests.master.rig import Rig

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
                self.n_syncs = self.n_syncs % 50 + 1  # counts, too few for a contact
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


OTHER_SYNC = Frame(cia.SYNC_ID, bytes([1]))
"""Of another master: with a counter."""


class MisbehavingRig(Rig):
    """A master of such patches; ``violations`` are readings that were used as fresh and are not."""

    def __init__(self, scene):
        arm = load_arm("pad").with_rate(50.0) if scene == "pad" else None
        super().__init__(scene, Misbehaving, arm, level="kmeans")  # contacts are not looked at
        self.violations = []
        self.period_ns = self.master.period_ns

    def kinds(self, node_id=None):
        """Kinds of events so far, of one patch if one is named."""
        return [event.kind for event in self.events if node_id in (None, event.node_id)]

    def take(self, report):
        super().take(report)
        for p in np.flatnonzero(report.fresh):
            counts = self.master.gather.counts[self.scene.arm.tactels_of(p)]
            if (counts != self.patches.own).any():
                self.violations.append((report.t_ns, int(p)))


def booted(scene):
    """Return a rig whose patches all are fresh."""
    rig = MisbehavingRig(scene)
    rig.run(1200)
    assert rig.fresh(100).all()
    return rig
