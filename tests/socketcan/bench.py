"""What SocketCAN costs, measured side by side in one run on a real kernel; ratios are what counts.

tools/socketcan .venv/bin/python -m tests.socketcan.bench WHAT
WHAT: cost, latency, endurance FRAMES
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import can
import numpy as np

from skinbus.bus.socketcan import SocketCanBus
from skinbus.can.frame import Frame, FrameBatch
from skinbus.config.system import load_arm, ods_of
from skinbus.model import Arm
from skinbus.objects.readings import ReadingsPlan
from tests.socketcan.many import many_patches

CHANNEL = "vcan0"
FULL_BUS_HZ = 8000
"""Frames a second of a full 1 Mbit/s bus."""

TICKS_HZ = 100
"""Bursts a second that these come in: one a cycle of 100 Hz."""

SECONDS = 20.0
"""Of cycles that latency is measured over."""


def cost() -> None:
    """Time per frame of our reader, decoding included, and of python-can, which does not decode."""
    arm: Arm = load_arm("forearm")
    plan = ReadingsPlan(arm, ods_of(arm))
    counts, seen = np.zeros(arm.n_tactels, np.int32), np.zeros(arm.n_patches, np.int32)
    bad = np.zeros(arm.n_patches, np.int32)
    burst = FrameBatch(plan.n_frames)
    plan.pack(counts, burst)
    some = list(burst)
    print(
        "burst  ours us/frame  python-can us/frame  ratio   (medians of 200; ours with decoding and stamps)"
    )
    for n in (1, 8, 64, 256):
        frames = (some * 3)[:n]
        times: list[list[float]] = [[], []]
        with SocketCanBus(CHANNEL) as sender, SocketCanBus(CHANNEL) as ours:
            ours.listen(plan.cob_ids, plan.cob_ids)
            theirs = can.Bus(CHANNEL, interface="socketcan")
            for _ in range(200):
                sender.send(frames)
                begin = time.perf_counter_ns()
                ours.receive()
                plan.unpack(ours.batch, counts, seen, bad)
                middle = time.perf_counter_ns()
                for _ in range(n):
                    theirs.recv(1.0)
                times[1].append((time.perf_counter_ns() - middle) / n / 1e3)
                times[0].append((middle - begin) / n / 1e3)
                assert ours.batch.n == n
            theirs.shutdown()
        a, b = (float(np.median(t)) for t in times)
        print(f"{n:5d}  {a:13.2f}  {b:19.2f}  {b / a:5.1f}")


def latency() -> None:
    """From the last readings of a cycle to its first contact and to its summary, all in the socket."""
    with tempfile.TemporaryDirectory() as folder:
        for arm, scene in (("forearm", "forearm"), many_patches(Path(folder))):
            loaded = load_arm(arm)
            data_ids = ReadingsPlan(loaded, ods_of(loaded)).cob_ids
            sim = spawn("sim", scene, "--channel", CHANNEL)
            run = spawn("run", arm, "--channel", CHANNEL, "--quiet")
            ends: list[tuple[float, float]] = []
            n_cycles, computes = 0, []
            with SocketCanBus(CHANNEL) as observer:
                wait_for_contacts(observer)
                last = first = summary = 0
                end_s = time.monotonic() + SECONDS
                while time.monotonic() < end_s:
                    for frame in observer.receive(0.5):
                        if frame.can_id in data_ids:
                            last, first = frame.t_ns, 0
                        elif frame.can_id == 0x1FF:  # the summary goes before the contacts
                            n_cycles += 1
                            summary = frame.t_ns
                            computes.append(int.from_bytes(frame.data[4:6], "little"))
                        elif 0x681 <= frame.can_id <= 0x690 and last and not first:
                            first = frame.t_ns
                            ends.append((first - last, summary - last))
            for process in (run, sim):
                process.send_signal(signal.SIGINT)
                process.wait()
            us = np.array(ends).reshape(-1, 2) / 1e3
            if not len(us):
                print(f"{loaded.n_patches} patches: no contact in {n_cycles} cycles")
                continue
            p50, p99 = np.percentile(us, [50, 99], axis=0)
            print(f"{loaded.n_patches} patches at {loaded.bus.rate_hz:g} Hz, {n_cycles} cycles,", end=" ")
            print(
                f"{len(us)} with contacts: "
                f"last PDO to first contact p50 {p50[0]:.0f} us, p99 {p99[0]:.0f} us; "
                f"to summary p50 {p50[1]:.0f} us, p99 {p99[1]:.0f} us; "
                f"of it computing p50 {np.median(computes):.0f} us, p99 {np.percentile(computes, 99):.0f} us"
            )


def endurance(n_frames: int) -> None:
    """So many frames at the pace of a full bus, from another process: none may be lost."""
    per_tick = FULL_BUS_HZ // TICKS_HZ
    n_sent = n_frames // per_tick * per_tick
    pid = os.fork()
    if pid == 0:
        with SocketCanBus(CHANNEL) as sender:
            frames = [Frame(0x181 + i % 100, bytes(8)) for i in range(per_tick)]
            next_s = time.monotonic() + 0.5
            for _ in range(n_sent // per_tick):
                time.sleep(max(0.0, next_s - time.monotonic()))
                sender.send(frames)
                # A wire has a pace: a sender that was held up goes on, it does not catch up.
                next_s = max(next_s, time.monotonic() - 1.0 / TICKS_HZ) + 1.0 / TICKS_HZ
        os._exit(0)
    data_ids = frozenset(range(0x181, 0x181 + 100))
    with SocketCanBus(CHANNEL) as reader:
        reader.listen(data_ids, data_ids)
        n, most, cpu = 0, 0, time.process_time()
        begin_s = time.monotonic()
        while n < n_sent:
            reader.receive(5.0)
            n += reader.batch.n
            most = max(most, reader.batch.n)
            if not reader.batch.n:
                break
        took_s = time.monotonic() - begin_s
        print(
            f"endurance: {n} of {n_sent} frames in {took_s:.0f} s, {reader.n_dropped} dropped, "
            f"{n_sent - n - reader.n_dropped} unaccounted; {n / took_s:.0f} frames/s, "
            f"at most {most} in one read; "
            f"{(time.process_time() - cpu) / max(n, 1) * 1e6:.1f} us of CPU a frame"
        )
    os.waitpid(pid, 0)


def spawn(*words: str) -> subprocess.Popen[bytes]:
    """A command of ours."""
    return subprocess.Popen([sys.executable, "-m", "skinbus", *words], stdout=subprocess.DEVNULL)


def wait_for_contacts(observer: SocketCanBus) -> None:
    """Wait for a contact with force."""
    while not any(0x681 <= f.can_id <= 0x690 and any(f.data[6:]) for f in observer.receive(1.0)):
        pass


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["endurance", n]:
            endurance(int(n))
        case ["latency"]:
            latency()
        case _:
            cost()
