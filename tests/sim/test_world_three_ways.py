"""One scene, one seed, three ways: virtual clock, virtual bus, an interface that crosses processes."""

import os
import threading

import pytest

from skinbus.bus.loop import run_core
from skinbus.bus.pythoncan import PythonCanBus
from skinbus.can.core import Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.config.system import ods_of
from skinbus.sim.scene_file import scene_of
from skinbus.sim.world import World
from tests.own_bus import own_port

N_SYNCS = 25
BOOT_NS = 1_000_000_000  # boards boot within 50 ms; some boot-up messages are lost in this scene
PATIENCE_NS = 60_000_000_000  # nothing waits that long when all is well
PORT = own_port()
GROUP = "239.74.163.7"

DOCUMENT = {
    "scene": {"arm": "forearm", "duration_s": 1.0, "seed": 11},
    "touch": [
        {
            "link": "forearm",
            "path": [[0.0, 30.0, 0.0], [0.5, 80.0, 60.0]],
            "force_n": [[0.0, 4.0], [1.0, 9.0]],
        }
    ],
    "effect": {
        name: {}
        for name in ("noise", "gain_spread", "flicker", "drift", "adc", "sync_jitter", "misplaced", "corrupt")
    }
    | {"loss": {"probability": 0.05}},
}


class Starter(Core):
    """A master of few words: starts all nodes a while after the first has booted, sends SYNCs, and ends.

    It ends at the earliest when it has heard so many answers: a busy machine may hold them up.
    """

    cob_ids = None

    def __init__(self, period_ns, n_answers):
        self.period_ns = period_ns
        self.n_answers = n_answers
        self.n_syncs = 0
        self.next_ns = None
        self.heard: dict[int, list[bytes]] = {}

    def step(self, now_ns, frames=()):
        for frame in frames:
            if 0x180 < frame.can_id < 0x580 and self.n_syncs:
                self.heard.setdefault(frame.can_id, []).append(frame.data)
        out, events = [], []
        if self.next_ns is None and frames:
            self.next_ns = now_ns + BOOT_NS
        if self.next_ns is not None and now_ns >= self.next_ns:
            if self.n_syncs < N_SYNCS:
                if not self.n_syncs:
                    self.begin_ns = now_ns
                    out.append(Frame(0x000, b"\x01\x00"))
                out.append(Frame(0x080, bytes([self.n_syncs + 1])))
                self.n_syncs += 1
            elif count(self.heard) >= self.n_answers or now_ns > self.begin_ns + PATIENCE_NS:
                events.append(Event(t_ns=now_ns, kind=EventKind.STOP))
            self.next_ns += self.period_ns
        return Step(out, events, self.next_ns or now_ns + self.period_ns)


def count(heard):
    """Frames of all identifiers."""
    return sum(map(len, heard.values()))


def start(n_answers):
    scene = scene_of(DOCUMENT)
    period_ns = round(1e9 / scene.arm.bus.rate_hz)
    return World(scene, ods_of(scene.arm)), Starter(period_ns, n_answers)


@pytest.fixture(scope="module")
def on_the_virtual_clock():
    world, starter = start(0)
    wire = VirtualBus()
    wire.attach(world)
    wire.attach(starter)
    wire.run(BOOT_NS + 1_000_000_000)
    assert starter.n_syncs == N_SYNCS
    return starter.heard


@pytest.mark.parametrize("interface", ["virtual", "udp_multicast"])
def test_scene_sends_the_same_bytes_on_every_bus(on_the_virtual_clock, interface):
    def open_bus():
        if interface == "virtual":
            return PythonCanBus("virtual", f"three-ways-{os.getpid()}")
        return PythonCanBus("udp_multicast", GROUP, options={"port": PORT})

    world, starter = start(count(on_the_virtual_clock))
    stop = threading.Event()
    thread = threading.Thread(target=lambda: run_core(world, open_bus, stop=stop), daemon=True)
    thread.start()
    try:
        run_core(starter, open_bus, stop=threading.Event())
    finally:
        stop.set()
        thread.join()
    assert starter.heard == on_the_virtual_clock
    assert count(starter.heard) > 0.9 * N_SYNCS * 24 * 4
