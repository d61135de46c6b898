"""A guarded arm on the bit-exact bus: boards, master and guard are cores, and any may be broken."""

from copy import deepcopy
from functools import partial

import numpy as np

from skinbus.can.core import NEVER
from skinbus.can.event import EventKind
from skinbus.can.virtual_buses import VirtualBuses
from skinbus.config.system import ods_of
from skinbus.guard.stops import parse_stop
from skinbus.guard.watch import Guard, Phase
from skinbus.master import Master
from skinbus.node import Device, PatchHost, Sample
from tests.bus.cores import Talker
from tests.guard.rig import GFC, MS, QUICK_STOP
from tests.master.misbehaving import Wrapped

LIVENESS_MS, KPA, NEWTONS = 20, 30, 60
AREA = 0.0125**2
"""m2, of a tactel: 16 on 50 x 50 mm."""
GUARD = f"""
[guard]
liveness_ms = {LIVENESS_MS}
[[guard.region]]
name = "boards"
patches = {{patches}}
pressure_kpa = {KPA}
force_n = {NEWTONS}
source = "a test"
"""
PLATE = """
[arm]
name = "plate"
[[link]]
name = "plate"
surface = "plane"
length_mm = 250
width_mm = 60
"""
BOARDS = (30, 82, 200)
"""mm; only the first two are guarded, with node-IDs 1 and 2."""
PLATE += "".join(
    f'[[patch]]\nnode_id = {k}\nlink = "plate"\ns_mm = {s_mm}\n' for k, s_mm in enumerate(BOARDS, 1)
)
PLATE += GUARD.format(patches=[1, 2])


class Plug(Wrapped):
    """A core between filters of what it hears and says."""

    def __init__(self, core):
        super().__init__(core)
        self.repair()

    def repair(self):
        self.hears = self.says = lambda frame: True

    def step(self, now_ns, frames):
        step = self.device.step(now_ns, [*filter(self.hears, frames)])
        return step._replace(frames=[*filter(self.says, step.frames)])


class Whole:
    """All of them; a drive would be node 100 of the first bus, but nobody answers there."""

    def __init__(self, arm, seed=0):
        self.arm, rng = arm, np.random.default_rng(seed)
        self.ods = ods_of(self.arm)
        buses = self.arm.buses
        self.wires = VirtualBuses(
            [bus.bitrate for bus in buses], data_bitrates=[bus.data_bitrate for bus in buses]
        )
        self.counts = np.zeros(self.arm.n_tactels, np.int32)
        self.healthy = np.ones(self.arm.n_tactels, np.bool_)
        self.age_ns, self.frozen_ns = 0, None
        self.judged = [np.zeros(0) for _ in self.ods]
        """Which tactels of each board were healthy at the last look."""
        self.strangers = []
        self.again_ns, self.crossed_ns = 0, {}
        """When a board was first pressed beyond its limits while it guarded."""
        self.scans = [[] for _ in self.ods]
        """When each board has looked at its tactels, ns."""
        self.beats = {}
        """The last sign of life of the master on each bus."""
        self.boards = [self.board(p, 1e-3 * rng.uniform(5, 50)) for p in range(self.arm.n_patches)]
        self.ports = [self.wire(p).attach(board) for p, board in enumerate(self.boards)]
        self.master = Master(self.arm, level="kmeans")
        self.master_ports = self.wires.attach(self.master)
        self.frames, self.events = [], []
        where = f"{buses[0].name}/" if len(buses) > 1 else ""
        drive = [parse_stop(f"cia402:{where}100", self.arm)]
        self.fresh = Guard(self.arm, self.arm.guard, self.ods, drive, acknowledges=True)
        self.plug = Plug(self.new_guard())
        self.guard_ports = self.wires.attach(self.plug, on_event=self.events.append)
        self.bus = self.wires.wires[0]
        for bus, wire in enumerate(self.wires.wires):
            wire.tap(partial(self.hear, bus))

    def board(self, p, boot_s=0.0):
        device = Device(self.ods[p], int(self.arm.node_id[p]), storage={})
        return Plug(PatchHost([device], partial(self.newest, p), [boot_s]))

    def new_guard(self):
        return deepcopy(self.fresh, {id(same): same for same in (self.arm, self.arm.guard)})

    @property
    def guard(self):
        return self.plug.device

    @property
    def now_ns(self):
        return self.wires.clock.now_ns()

    def wire(self, p):
        return self.wires.wires[self.arm.patches[p].bus]

    def device(self, p):
        return self.boards[p].device.devices[0]

    def hear(self, bus, frame):
        self.frames.append(frame._replace(bus=bus))
        if frame.can_id == 0x77F:
            self.beats[bus] = self.frames[-1]

    def newest(self, p, now_ns):
        self.scans[p].append(now_ns)
        own = self.arm.tactels_of(p)
        if self.judged[p].base is not self.healthy:  # a host looks only at another array
            self.judged[p] = self.healthy[own]
        t_ns = now_ns - self.age_ns if self.frozen_ns is None else self.frozen_ns
        return Sample(self.counts[own], np.array([t_ns]), self.judged[p])

    def run(self, ms):
        self.wires.run(self.now_ns + round(ms * MS))

    def until_guarding(self, ms=10.0):
        """Let time pass until it has guarded for so long; return this."""
        since_ns = NEVER
        while self.now_ns < since_ns + ms * MS:
            assert self.now_ns < self.again_ns + 8000 * MS, f"does not guard: {self.events[-3:]}"
            self.run(1)
            if self.guard.phase is Phase.STOPPED:  # by what was broken before
                self.renew()
            since_ns = NEVER if self.guard.phase is not Phase.GUARDING else min(since_ns, self.now_ns)
        return self

    def join(self, core):
        """Let a stranger onto the first bus, until it is repaired."""
        self.strangers.append(self.bus.attach(core))

    def say(self, *frames):
        """Let somebody say something on the first bus."""
        for frame in frames:
            self.join(Talker([(0, frame)]))

    def repair(self):
        """Undo what was done to anybody, on one bus."""
        for plug in (*self.boards, self.plug):
            plug.repair()
        self.healthy, self.age_ns, self.frozen_ns = np.ones_like(self.healthy), 0, None
        for port in self.strangers:
            self.bus.detach(port)
        for port in (*self.ports, *self.master_ports, *self.guard_ports):
            self.bus.restart(port)
        self.again()

    def again(self):
        """Let nothing press, and another guard begin."""
        self.again_ns = self.now_ns
        self.counts = np.zeros_like(self.counts)
        self.renew()

    def renew(self):
        """Let another guard wait until all are armed: it takes trips back, and has heard of the master."""
        self.plug.device, self.crossed_ns = self.new_guard(), {}
        self.guard.step(self.now_ns, [*self.beats.values()])
        del self.frames[:], self.events[:]

    def press(self, tactels, kpa):
        """Press on some tactels, too."""
        step = self.arm.patches[0].patch.transducer.step
        self.counts = self.counts.copy()
        self.counts[tactels] = np.maximum(self.counts[tactels], round(1e3 * kpa / step))
        felt = step * self.counts.reshape(-1, 16)
        is_beyond = (felt.max(axis=1) > 1e3 * KPA) | (AREA * felt.sum(axis=1) > NEWTONS)
        if self.guard.phase is Phase.GUARDING:
            for p in np.flatnonzero(is_beyond & self.arm.guarded).tolist():
                self.crossed_ns.setdefault(p, self.now_ns)

    def gfc_ns(self):
        """When frames of a stop ended."""
        return [frame.t_ns for frame in self.frames if frame.can_id == GFC]

    def stops_ns(self):
        """When the guard has stopped."""
        return [event.t_ns for event in self.events if event.kind is EventKind.GUARD_STOP]

    def told_ns(self):
        """When the drive was told to."""
        return [frame.t_ns for frame in self.frames if frame[:2] == QUICK_STOP]
