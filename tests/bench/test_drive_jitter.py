"""How late the driver wakes a core on a real clock, and what a frame costs on python-can's virtual bus."""

import threading

import pytest

from skinbus.bus.loop import run_core
from skinbus.bus.pythoncan import PythonCanBus
from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from tests.own_bus import own_group

pytestmark = pytest.mark.slow

PERIOD_NS = 5_000_000
N_CYCLES = 200


class Metronome(Core):
    """Sends SYNC at 200 Hz for one second."""

    cob_ids = frozenset()

    def __init__(self) -> None:
        self.n = 0
        self.next_ns = 0

    def step(self, now_ns, frames):
        if self.n == 0:
            self.next_ns = now_ns
        if now_ns < self.next_ns:
            return Step((), (), self.next_ns)
        self.n += 1
        self.next_ns += PERIOD_NS
        if self.n > N_CYCLES:
            return Step((), (Event(t_ns=now_ns, kind=EventKind.STOP),), NEVER)
        return Step((Frame(0x80),), (), self.next_ns)


@pytest.mark.parametrize("interface", ["virtual", "udp_multicast"])
def test_lateness_of_200_wake_ups(benchmark, interface):
    report = benchmark.pedantic(
        lambda: run_core(
            Metronome(),
            lambda: PythonCanBus(interface, own_group()),
            stop=threading.Event(),
            keep_late=N_CYCLES,
        ),
        rounds=1,
    )
    late_us = sorted(late_ns / 1000 for late_ns in report.late_ns)
    benchmark.extra_info["late_us"] = {
        "p50": late_us[len(late_us) // 2], "p99": late_us[int(0.99 * len(late_us))], "max": late_us[-1]
    }  # fmt: skip
    print(f"late by (us): {benchmark.extra_info['late_us']}")
    assert report.n_sent == N_CYCLES


def test_500_frames_over_the_virtual_bus(benchmark):
    frames = [Frame(0x180 + k, bytes(8)) for k in range(500)]
    with PythonCanBus("virtual", "bench") as a, PythonCanBus("virtual", "bench") as b:

        def cross():
            a.send(frames)
            return b.receive(1.0)

        assert len(benchmark(cross)) == 500
