"""A virtual clock, an interface that moves it, and the loop run on both until a given time."""

import threading

from skinbus.bus.interface import Bus
from skinbus.bus.loop import Loop
from skinbus.can.clock import VirtualClock
from skinbus.can.frame import FrameBatch
from skinbus.errors import BusError

MS = 1_000_000


CALL_NS = 1_000  # what a call of the interface that finds nothing takes


class FakeBus(Bus):
    """An interface on a virtual clock: frames arrive at their times, and it can be down for a while."""

    def __init__(self, clock):
        self.clock = clock
        self.batch = FrameBatch(1)
        self.arrivals = []
        self.outage = None
        self.sent = []
        self.is_open = False

    def open(self):
        self.check("cannot be opened")
        self.is_open = True
        return self

    def listen(self, cob_ids, data_ids=frozenset()):
        assert not data_ids

    def check(self, what):
        if self.outage and self.outage[0] <= self.clock.now_ns() < self.outage[1]:
            raise BusError(what)

    def receive(self, timeout_s):
        assert self.is_open
        self.check("network is down")
        now_ns = self.clock.now_ns()
        until_ns = now_ns + max(CALL_NS, round(timeout_s * 1e9))
        if self.arrivals and self.arrivals[0].t_ns <= until_ns:
            until_ns = max(now_ns, self.arrivals[0].t_ns)
        self.clock.move_to(until_ns)
        due = [frame for frame in self.arrivals if frame.t_ns <= until_ns]
        self.arrivals = self.arrivals[len(due) :]
        return due

    def send(self, frames):
        assert self.is_open
        self.check("network is down")
        self.sent += [(self.clock.now_ns(), frame) for frame in frames]
        return len(frames)

    def close(self):
        self.is_open = False


class VirtualStop(threading.Event):
    """Set at a given time; waiting moves the clock."""

    def __init__(self, clock, at_ns):
        super().__init__()
        self.clock, self.at_ns = clock, at_ns

    def is_set(self):
        return self.clock.now_ns() >= self.at_ns

    def wait(self, timeout=None):
        self.clock.move_to(self.clock.now_ns() + max(CALL_NS, round(timeout * 1e9)))
        return self.is_set()


def run(core, *, until_ns, arrivals=(), outage=None, **more):
    """Run a core on as many buses as it has; the first one is down for a while."""
    clock = VirtualClock()
    buses = [FakeBus(clock) for _ in range(core.n_buses)]
    buses[0].outage = outage
    for frame in arrivals:
        buses[frame.bus].arrivals.append(frame._replace(bus=0))
    opens = [bus.open for bus in buses]
    return buses, Loop(core, opens, stop=VirtualStop(clock, until_ns), clock=clock, **more).run()
