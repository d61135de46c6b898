"""What SocketCAN costs, and how soon a guard stops, on a real kernel; of costs ratios are what counts.

tools/socketcan .venv/bin/python -m tests.socketcan.bench
"""

import multiprocessing
import time
from functools import partial

import can
import numpy as np

from skinbus.bus.core_thread import CoreThread
from skinbus.bus.socketcan import SocketCanBus
from skinbus.can.frame import Frame
from skinbus.config.system import load_arm, ods_of
from skinbus.guard.watch import Phase
from skinbus.node import Device, PatchHost, Sample
from skinbus.objects.guard import GuardLimits
from skinbus.objects.readings import ReadingsPlan
from tests.guard.rig import GFC, MS, QUICK_STOP, Rig

CHANNEL = "vcan0"
OPEN = partial(SocketCanBus, CHANNEL)
N_PRESSES = 200
PERIOD_NS, PRESS_NS = 500_370_000, 100 * MS
"""A press begins with each period of the clock of this machine, in any phase of the samples."""


def cost():
    """Time per frame of our reader, decoding included, and of python-can, which does not decode."""
    arm = load_arm("forearm")
    plan = ReadingsPlan(arm, ods_of(arm))
    counts, seen = np.zeros(arm.n_tactels, np.int32), np.zeros(arm.n_patches, np.int32)
    some = [Frame(cob_id, bytes(8)) for cob_id in plan.cob_ids_on[0]]
    print(
        "burst  ours us/frame  python-can us/frame  ratio   (medians of 200; ours with decoding and stamps)"
    )
    for n in (1, 8, 64, 256):
        frames = (some * 3)[:n]
        times = [[], []]
        with OPEN() as sender, OPEN() as ours:
            ours.listen(plan.cob_ids_on[0], plan.cob_ids_on[0])
            theirs = can.Bus(CHANNEL, interface="socketcan")
            for _ in range(200):
                sender.send(frames)
                begin = time.perf_counter_ns()
                ours.receive()
                plan.unpack(ours.batch, counts, seen)
                middle = time.perf_counter_ns()
                for _ in range(n):
                    theirs.recv(1.0)
                times[1].append((time.perf_counter_ns() - middle) / n / 1e3)
                times[0].append((middle - begin) / n / 1e3)
                assert ours.batch.n == n
            theirs.shutdown()
        a, b = (float(np.median(t)) for t in times)
        print(f"{n:5d}  {a:13.2f}  {b:19.2f}  {b / a:5.1f}")


def guard_again():
    """Guard, and begin anew after each stop, when nothing presses: trips are taken back."""
    while True:
        guard = Rig(acknowledges=True).guard
        thread = CoreThread(guard, OPEN, urgent=True)
        thread.start()
        while guard.phase is not Phase.STOPPED:
            time.sleep(0.05)
        time.sleep(1e-9 * PRESS_NS)
        thread.stop()


def guard():
    """Time from a reading above its limit to GFC and to the stop: a patch, and a process that guards.

    A frame takes no time on vcan: what is measured is how long programs and kernel of that machine take.
    """
    arm = Rig().arm
    n, device = arm.n_tactels, Device(ods_of(arm)[0], 1)

    def newest(now_ns):
        counts = np.full(n, 2000 * (now_ns % PERIOD_NS < PRESS_NS))
        return Sample(counts, np.array([now_ns]), np.ones(n, np.bool_))

    multiprocessing.get_context("spawn").Process(target=guard_again, daemon=True).start()
    CoreThread(PatchHost([device], newest), OPEN).start()
    time.sleep(1.0)
    limits = GuardLimits(1, 1, 2**31 - 1, np.full(n, 1000), *np.ones((2, n), int))
    for place, value in {(0x1808, 1): 0x501, (0x1808, 5): 20, (0x2081, 0): limits.encode()}.items():
        device.set(*place, value)
    times = {GFC: {}, QUICK_STOP[0]: {}}  # by press, the first: requests are repeated
    with OPEN() as observer:
        observer.send([Frame(0, b"\x01\x00")])
        while len(times[QUICK_STOP[0]]) < N_PRESSES:
            for frame in observer.receive(1.0):
                press, late_ns = divmod(frame.t_ns, PERIOD_NS)
                times.get(frame.can_id, {}).setdefault(press, late_ns / MS)
    print("ms from a press to GFC, and to the request to a drive: median, 99th percentile, worst")
    print(*(np.percentile([*found.values()], [50, 99, 100]).round(2) for found in times.values()))


if __name__ == "__main__":
    cost()
    guard()
