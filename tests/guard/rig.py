"""A guard on a virtual clock, and the frames that keep it content."""

import numpy as np

from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.config.system import load_arm, ods_of
from skinbus.guard.stops import parse_stop
from skinbus.guard.watch import Guard, Phase, RegionPeaks
from skinbus.model.guard import GuardRegion, GuardSettings
from skinbus.objects.guard import liveness_pdo

MS = 1_000_000
PERIOD = 20 * MS
"""Of liveness."""
LOST, MASTER_LOST = 50 * MS, 1250 * MS
"""So long a patch and a master may be silent."""
ARMED, TRIPPED, ARMED_AND_TRIPPED, IDLE = 1, 2, 3, 0
GFC = 0x001
ARMS = {name: load_arm(name) for name in ("pad", "arm-two-buses")}
QUICK_STOP = (0x664, bytes.fromhex("2b40600002000000"))
"""The request that stops the drive, node 100."""


def first_patches(arm, **limits):
    """Guard the first patch of each bus, each patch a region."""
    regions = [
        GuardRegion(name="region", tactels=arm.tactel_patch == p, source="a test", **limits)
        for p in arm.bus_start[:-1].tolist()
    ]
    arm.guard = GuardSettings(regions=tuple(regions), liveness_ns=PERIOD, transient_ns=100 * MS)
    return arm


class Rig:
    """A guard, with drives to be stopped on the last bus."""

    def __init__(self, name="pad", *, stops=("cia402:100",), **settings):
        self.arm = first_patches(ARMS[name], force=10.0, pressure=3e4, transient_factor=2.0)
        self.where = f"{self.arm.buses[-1].name}/" if len(self.arm.buses) > 1 else ""
        told = [parse_stop(stop.replace(":", f":{self.where}", 1), self.arm) for stop in stops]
        ods = ods_of(self.arm)
        self.guard = Guard(self.arm, self.arm.guard, ods, told, **settings)
        self.patches = [
            (bus, int(self.arm.node_id[p]), liveness_pdo(ods[p]).cob_id)
            for bus, p in enumerate(self.arm.bus_start[:-1].tolist())
        ]
        self.last_bus = len(self.arm.buses) - 1
        self.now_ns = 10**9
        self.sent, self.events = [], []

    def step(self, *frames, after=0):
        """Let time pass and the guard take frames, stamped now; return what it sends."""
        self.now_ns += after
        step = self.guard.step(self.now_ns, [frame._replace(t_ns=self.now_ns) for frame in frames])
        assert step.wake_ns > self.now_ns
        self.sent += step.frames
        self.events += step.events
        return [frame[:2] for frame in step.frames]

    def state(self, k, state, tripped_by=0):
        """The frame with the state of the guard of a patch."""
        bus, _, cob_id = self.patches[k]
        return Frame(cob_id, bytes([state, tripped_by]), bus=bus)

    def well(self, but=None):
        """One sign of life of everybody but one."""
        frames = [self.state(k, ARMED) for k in range(len(self.patches))]
        frames += [Frame(0x77F, b"\x05", bus=bus) for bus in range(self.guard.n_buses)]
        return [frame for k, frame in enumerate(frames) if k != but]

    def guarding(self):
        """Return this, when it guards."""
        self.step(*self.well())
        assert self.guard.phase is Phase.GUARDING
        return self

    def press(self, *forces, pa=0.0, after=20 * MS):
        """Let the master show the largest forces in the regions, and a pressure in all."""
        self.now_ns += after
        n = len(self.patches)
        self.guard.contacts = RegionPeaks(self.now_ns, np.resize(forces, n).tolist(), [pa] * n)
        return self.step(*self.well())

    def answer(self, data="6040600000000000"):
        """A frame of the drive, by default the one that confirms."""
        return Frame(0x5E4, bytes.fromhex(data), bus=self.last_bus)

    def count(self, kind):
        """How many events of a kind there were."""
        return [event.kind for event in self.events].count(kind)

    @property
    def is_stopped(self):
        """Whether the drive was told to stop, and why is said once."""
        told = [frame for frame in self.sent if (frame[:2], frame.bus) == (QUICK_STOP, self.last_bus)]
        assert self.count(EventKind.GUARD_STOP) == bool(told) == (self.guard.phase is Phase.STOPPED)
        return bool(told)
