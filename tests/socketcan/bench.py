"""What SocketCAN costs, measured side by side in one run on a real kernel; ratios are what counts.

tools/socketcan .venv/bin/python -m tests.socketcan.bench cost
"""

import time

import can
import numpy as np

from skinbus.bus.socketcan import SocketCanBus
from skinbus.can.frame import Frame
from skinbus.config.system import load_arm, ods_of
from skinbus.objects.readings import ReadingsPlan

CHANNEL = "vcan0"


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
        with SocketCanBus(CHANNEL) as sender, SocketCanBus(CHANNEL) as ours:
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


if __name__ == "__main__":
    cost()
