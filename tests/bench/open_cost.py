"""Measures what `skinbus.open` adds to a cycle of `skinbus run`: python -m tests.bench.open_cost [CYCLES]

One master of the forearm, 24 patches and 5 contacts. Its cycles end in turn as those of `run` do, as those of
`open` do whose program waits for nothing, and as those of `open` do with a program in another thread that
takes each cycle and reads force and place of its contacts. Printed are medians, and ratios of neighbouring
cycles: until the frames of the cycle are there to be sent, and with handing it over, which follows.
"""

import sys
import threading
import time
from collections import deque

import numpy as np

from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.can.frame import FrameBatch
from skinbus.can.virtual_bus import VirtualBus
from skinbus.cli.formatting import counted
from skinbus.cli.notify import Notifier
from skinbus.master import Master
from skinbus.model import Cone
from skinbus.objects import cia
from skinbus.sim import World, load_scene
from skinbus.skin.feed import PushFeed
from skinbus.skin.master_cycles import CycleMaker
from skinbus.skin.skin import Skin

TOUCHES = [(0.025, 0.0), (0.0255, 0.1275), (0.051, -0.1), (0.077, 0.0765), (0.128, -0.05)]
"""(s, a) in m: two of them on seams, the rest inside patches."""
N_QUIET = 100
"""Cycles in which zeros are found before the touches."""


def readings(master, n=32):
    """The data frames of cycles with five touches, and of as many without."""
    arm, plan = master.arm, master.gather.plan
    law, surface, rng = Cone(2e6), arm.links[0].surface, np.random.default_rng(1)
    pressed = sum(law.pressure(surface.distance(arm.tactel_s, arm.tactel_a, *at), 12.0) for at in TOUCHES)
    batches = []
    for k in range(2 * n):
        noisy = (pressed if k < n else 0.0) + 200.0 * rng.standard_normal(arm.n_tactels)
        batch = FrameBatch(plan.n_frames)
        plan.pack(np.rint(noisy / plan.counts_scale).astype(np.int32), batch)
        batches.append(batch)
    return batches[:n], batches[n:]


def main(n_cycles=3000):
    """Measure and print."""
    scene = load_scene("forearm")
    reports, computes, notifier = deque(maxlen=1), deque(maxlen=10_000), Notifier()
    end = [None]
    master = Master(scene.arm, on_cycle=lambda report: end[0](report))
    makers = [CycleMaker(scene.arm, MonotonicClock()) for _ in range(2)]  # each counts its cycles
    alone, followed = (PushFeed(maker.layout) for maker in makers)

    def as_run(report):
        reports.append(report)
        computes.append(report.compute_ns)
        fresh, n = report.n_fresh, len(report.contacts)
        notifier.alive(f"{fresh} of {counted(scene.arm.n_patches, 'patch')}, {counted(n, 'contact')}")

    def hand_over(feed, maker):
        feed.push(maker.make(master, reports[0]))

    ends = {
        "run": (as_run, lambda: None),
        "open": (reports.append, lambda: hand_over(alone, makers[0])),
        "open, followed": (reports.append, lambda: hand_over(followed, makers[1])),
    }
    end[0] = as_run
    wire = VirtualBus(scene.arm.bus.bitrate)
    wire.attach(World(scene))
    wire.attach(master)
    wire.run(1_500_000_000)
    assert master.table.is_running.all()
    touched, quiet = readings(master)

    read = []

    def follow():
        with Skin(followed) as skin:
            for cycle in skin:
                read.append(sum(contact.force + contact.s for contact in cycle.contacts))

    thread = threading.Thread(target=follow)
    thread.start()
    now_ns, times = 1_500_000_000, {name: [] for name in ends}
    names = list(ends)
    for k in range(N_QUIET + len(names) * n_cycles):
        while not any(frame.can_id == cia.SYNC_ID for frame in master.step(now_ns, []).frames):
            now_ns += 1_000_000
        master.table.last_heard[:] = now_ns  # their heartbeats come between the cycles
        batch = (quiet if k < N_QUIET else touched)[k % len(touched)]
        batch.t_ns[: batch.n] = now_ns + 6_000_000
        name = names[k % len(names)]
        end[0], after = ends[name]
        now_ns += 12_000_000
        time.sleep(0.0005)  # the program of the cycle before has had its time
        begin = time.perf_counter_ns()
        master.take(now_ns, batch)
        master.step(now_ns, [])
        out = time.perf_counter_ns()
        after()
        if k >= N_QUIET + 300:
            times[name].append((out - begin, time.perf_counter_ns() - begin))
        now_ns += 1_000_000
    followed.end()
    thread.join()
    n = min(map(len, times.values()))
    for part, what in enumerate(("until its frames are out", "with handing over")):
        base = np.array(times["run"][:n])[:, part] / 1e3
        for name, took in times.items():
            own = np.array(took[:n])[:, part] / 1e3
            tenths = zip(np.array_split(base, 10), np.array_split(own, 10), strict=True)
            ratios = [np.median(b / a) for a, b in tenths]
            print(
                f"{what}, {name}: median {np.median(own):.0f} us, 90 % {np.percentile(own, 90):.0f} us;"
                f" over run {np.median(own / base):.3f} ({min(ratios):.3f} to {max(ratios):.3f} in tenths)"
            )
    print(f"{len(read)} cycles were read by the program")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
