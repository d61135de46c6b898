"""A guard on a virtual clock, and the frames that keep it content."""

import numpy as np

from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.config.system import load_arm
from skinbus.guard.stops import parse_stop
from skinbus.guard.watch import Guard, GuardedPatch, Phase, SeenContacts
from skinbus.model.guard import GuardRegion, GuardSettings

MS = 1_000_000
PERIOD = 20 * MS
"""Of liveness."""
MASTER = 200 * MS
"""Of the heartbeat of the master."""
LOST = PERIOD * 5 // 2
"""A patch may be silent so long."""
DRIVE = 100
"""Node-ID of the drive that stops."""
ARMED, TRIPPED, ARMED_AND_TRIPPED, IDLE = 1, 2, 3, 0
GFC = 0x001
ARMS = {name: load_arm(name) for name in ("pad", "arm-two-buses")}


class Rig:
    """A guard of the first patch of each bus, with a drive on the last bus to be stopped."""

    def __init__(self, name="pad", regions=(), stop="cia402", more=(), **settings):
        self.arm = arm = ARMS[name]
        self.patches = [
            GuardedPatch(
                label=str(p), bus=bus, node_id=int(arm.node_id[p]), cob_id=0x500 + int(arm.node_id[p])
            )
            for bus, p in enumerate(arm.bus_start[:-1].tolist())
        ]
        where = f"{arm.buses[-1].name}/{DRIVE}" if len(arm.buses) > 1 else f"{DRIVE}"
        self.stop = parse_stop(f"cia402:{where}" if stop == "cia402" else stop.format(where), arm)
        asked = GuardSettings(regions=tuple(regions), liveness_ns=PERIOD, transient_ns=100 * MS)
        self.guard = Guard(arm, asked, self.patches, more or [self.stop], master_period_ns=MASTER, **settings)
        self.now_ns = 10**9
        self.sent, self.events = [], []

    def step(self, *frames, after=0):
        """Let time pass and the guard take frames, stamped now; return what it sends."""
        self.now_ns += after
        step = self.guard.step(self.now_ns, [frame._replace(t_ns=self.now_ns) for frame in frames])
        assert step.wake_ns > self.now_ns
        self.sent += step.frames
        self.events += step.events
        return step.frames

    def state(self, patch, state, tripped_by=0):
        """The frame with the state of the guard of a patch."""
        return Frame(patch.cob_id, bytes([state, tripped_by]), bus=patch.bus)

    def well(self):
        """One sign of life of everybody."""
        masters = [Frame(0x700 + 127, b"\x05", bus=bus) for bus in range(self.guard.n_buses)]
        return [*(self.state(patch, ARMED) for patch in self.patches), *masters]

    def guarding(self):
        """Return this, when it guards."""
        self.step(*self.well())
        assert self.guard.phase is Phase.GUARDING
        return self

    def press(self, force, s=None, a=None, link=0, after=20 * MS):
        """Let the master show one contact, by default on the first tactel."""
        self.now_ns += after
        place = [self.arm.tactel_s[0] if s is None else s], [self.arm.tactel_a[0] if a is None else a]
        columns = np.array([link]), np.array(place[0]), np.array(place[1]), np.array([force])
        self.guard.contacts = SeenContacts(self.now_ns, *columns)
        return self.step(*self.well())

    def kinds(self):
        """Kinds of the events so far."""
        return [event.kind for event in self.events]

    def answer(self):
        """The frame by which the drive confirms a write."""
        index = self.stop.index.to_bytes(2, "little")
        return Frame(0x580 + DRIVE, b"\x60" + index + bytes([self.stop.sub, 0, 0, 0, 0]), bus=self.stop.bus)


def quick_stop(bus=0):
    """The request that stops the drive: an expedited download of two bytes to 0x6040."""
    return (0x600 + DRIVE, bytes.fromhex("2b406000 0200 0000"), bus)


def whole(arm, force=10.0, factor=2.0):
    """A region of all tactels."""
    tactels = np.ones(arm.n_tactels, np.bool_)
    return GuardRegion(name="all", tactels=tactels, force=force, transient_factor=factor, source="a test")


def is_stop(rig):
    """Whether the drive has been told to stop, and why is said once."""
    said = rig.kinds().count(EventKind.GUARD_STOP)
    told = quick_stop(rig.stop.bus) in [(f.can_id, f.data, f.bus) for f in rig.sent]
    assert said == told == (rig.guard.phase is Phase.STOPPED)
    return bool(said)
