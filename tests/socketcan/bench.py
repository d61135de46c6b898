"""What SocketCAN costs, measured side by side in one run on a real kernel; ratios are what counts.

tools/socketcan .venv/bin/python -m tests.socketcan.bench WHAT...
WHAT: cost, latency, stopped, recovery, many, four, hostile, endurance FRAMES
"""

import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import can
import canopen
import numpy as np

from skinbus.bus.socketcan import RECEIVE_BUFFER, SocketCanBus
from skinbus.can.frame import Frame, FrameBatch
from skinbus.config.system import load_arm, ods_of
from skinbus.model import Arm
from skinbus.objects.readings import ReadingsPlan
from tests.socketcan.can_rig import EDS, set_up
from tests.socketcan.hostile import SEED, N, cansend_text, hostile_frame
from tests.socketcan.many import four_buses, many_patches
from tests.socketcan.skin_rig import SYNC, assert_nothing_stale

CHANNEL = "vcan0"
FULL_BUS_HZ = 8000
"""Frames a second of a full 1 Mbit/s bus."""

TICKS_HZ = 100
"""Bursts a second that these come in: one a cycle of 100 Hz."""

RATES_HZ = 10.0, 15.0, 20.0, 30.0
FOUR_RATES_HZ = 5.0, 10.0, 15.0
COUNTERS = (("Cycle", "Cycles"), ("Frames", "Accepted"), ("Frames", "Lost"), ("Cycle", "Overruns"))

NO_PRIORITY = ("setpriv", "--inh-caps=-sys_nice", "--bounding-set=-sys_nice")

PATIENCE_S = 90.0
"""Until all patches of an arm have booted and sent their readings in one cycle."""

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


def recovery() -> None:
    """The interface down for 5 s, 20 times, in the middle of presses: time to the next contact."""
    sim = spawn("sim", "forearm", "--channel", CHANNEL)
    run = spawn("run", "forearm", "--channel", CHANNEL, "--quiet")
    took_s, memory_kb = [], []
    with SocketCanBus(CHANNEL) as observer:
        wait_for_contacts(observer)
    for _ in range(20):
        set_up(CHANNEL, False)
        time.sleep(5.0)
        begin_s = time.monotonic()
        set_up(CHANNEL, True)
        with SocketCanBus(CHANNEL) as observer:
            frames = wait_for_contacts(observer)
        took_s.append(time.monotonic() - begin_s)
        assert_nothing_stale(frames, 1)  # the cycle before the observer came may have had readings
        statm = Path(f"/proc/{run.pid}/statm").read_text()
        memory_kb.append(int(statm.split()[1]) * 4)
        time.sleep(1.0)
    print(
        f"recovery: {len(took_s)} of 20, median {np.median(took_s):.2f} s, longest {max(took_s):.2f} s, "
        f"nothing stale; resident kB {memory_kb}"
    )
    for process in (run, sim):
        process.send_signal(signal.SIGINT)
        process.wait()


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


def stopped() -> None:
    """A reader that stands still for 2 s while frames come: the socket's drop counter against those sent."""
    ids = frozenset({0x181})
    for buffer in (4096, RECEIVE_BUFFER):
        with SocketCanBus(CHANNEL) as sender, SocketCanBus(CHANNEL, receive_buffer=buffer) as reader:
            reader.listen(ids, ids)
            end_s, n_sent = time.monotonic() + 2.0, 0
            while time.monotonic() < end_s:
                n_sent += sender.send([Frame(0x181, bytes(8))] * 256)
            begin_s = time.monotonic()
            while reader.n_received + reader.n_dropped < n_sent and time.monotonic() < begin_s + 10.0:
                n_sent += sender.send([Frame(0x181, bytes(8))])  # the counter comes with the frame after it
                reader.receive(0.1)
            told = sum(event.count for event in reader.news())
            off = n_sent - reader.n_received - reader.n_dropped
            print(
                f"stopped for 2 s, {reader.receive_buffer >> 10} kB: {n_sent} sent = {reader.n_received} "
                f"received + {reader.n_dropped} dropped ({told} told), {off} off"
            )


def many() -> None:
    """126 patches on one interface, at rising rates: what is lost, what is late, what the cycles take."""
    for rate_hz in RATES_HZ:
        with tempfile.TemporaryDirectory() as folder:
            arm, scene = many_patches(Path(folder), rate_hz)
            if not hold(rate_hz, "126 patches", arm, scene, ["--channel", CHANNEL], CHANNEL):
                return


def four() -> None:
    """The same with four interfaces and 126 patches on each, into one master."""
    for rate_hz in FOUR_RATES_HZ:
        with tempfile.TemporaryDirectory() as folder:
            arm, scene, names = four_buses(Path(folder), rate_hz)
            for name in names:
                subprocess.run(["ip", "link", "add", f"vfour{name}", "type", "vcan"], check=False)
                set_up(f"vfour{name}", True)
            places = [word for name in names for word in ("--channel", f"{name}=vfour{name}")]
            if not hold(rate_hz, "4 x 126 patches", arm, scene, places, f"vfour{names[-1]}"):
                return


def hold(rate_hz: float, what: str, arm: str, scene: str, places: list[str], channel: str) -> bool:
    """Run an arm at a rate and print what came of it, asking the master on one channel; whether all came."""
    # vcan has no bit rate: the limit of the wire's load is lifted.
    unlimited = "import skinbus.config.system as a; a.MAX_LOAD = 1e9; from skinbus.cli import main; main()"
    sim = spawn("sim", scene, *places, program=("-c", unlimited))
    # Where all share one CPU, a master with real-time priority would read frame by frame as the patches send.
    run = spawn("run", arm, *places, "--quiet", program=("-c", unlimited), under=NO_PRIORITY)
    network = canopen.Network()
    network.connect(interface="socketcan", channel=channel)
    node = network.add_node(127, str(EDS / "skin-master.eds"))
    node.sdo.RESPONSE_TIMEOUT = 5.0
    try:
        give_up_s = time.monotonic() + PATIENCE_S
        while read(node, "Cycle", "Patches alive") != 126:
            if time.monotonic() > give_up_s:
                print(f"{what} at {rate_hz:g} Hz: no cycle with the readings of all in {PATIENCE_S:g} s")
                return False
            time.sleep(0.1)
        before, begin_s = [read(node, *name) for name in COUNTERS], time.monotonic()
        time.sleep(SECONDS)
        after, end_s = [read(node, *name) for name in COUNTERS], time.monotonic()
    finally:
        network.disconnect()
        for process in (run, sim):
            process.send_signal(signal.SIGINT)
            process.wait()
    took_s = end_s - begin_s
    cycles, accepted, lost, late = (b - a for a, b in zip(before, after, strict=True))
    print(
        f"{what} at {rate_hz:g} Hz: {cycles / took_s:.1f} cycles/s, "
        f"{accepted / took_s:.0f} frames/s, {lost} of {accepted + lost} frames lost, "
        f"{late} periods without contacts in time"
    )
    return True


def hostile() -> None:
    """10^4 hostile frames, each by a cansend(1) of its own: is there a contact, and an SDO answer?"""
    rng = random.Random(SEED)
    sim = spawn("sim", "forearm", "--channel", CHANNEL)
    run = spawn("run", "forearm", "--channel", CHANNEL, "--quiet")
    with SocketCanBus(CHANNEL) as observer:
        wait_for_contacts(observer)
    script = "".join(f"cansend {CHANNEL} {cansend_text(hostile_frame(rng))}\n" for _ in range(N))
    subprocess.run(["sh", "-e"], input=script, text=True, check=True)
    begin_s = time.monotonic()
    with SocketCanBus(CHANNEL) as observer:
        wait_for_contacts(observer)
    took_s = time.monotonic() - begin_s
    print(f"hostile: {N} frames by cansend, contacts {took_s:.2f} s after the last, {run.poll()=}")
    for process in (run, sim):
        process.send_signal(signal.SIGINT)
        process.wait()


def read(node: canopen.RemoteNode, record: str, member: str) -> int:
    """A number of the master's, once it is there and has time to answer."""
    while True:
        with contextlib.suppress(canopen.SdoCommunicationError):
            return int(node.sdo[record][member].raw)


def spawn(
    *words: str, program: tuple[str, ...] = ("-m", "skinbus"), under: tuple[str, ...] = ()
) -> subprocess.Popen[bytes]:
    """A command of ours."""
    return subprocess.Popen([*under, sys.executable, *program, *words], stdout=subprocess.DEVNULL)


def wait_for_contacts(observer: SocketCanBus) -> list[Frame]:
    """Wait for a contact with force; all frames from the first SYNC until then."""
    frames: list[Frame] = []
    while not any(0x681 <= f.can_id <= 0x690 and any(f.data[6:]) for f in frames):
        frames += observer.receive(1.0)
        while frames and frames[0].can_id != SYNC:
            del frames[0]
    return frames


BENCHES = {
    "cost": cost,
    "latency": latency,
    "stopped": stopped,
    "recovery": recovery,
    "many": many,
    "four": four,
    "hostile": hostile,
}

if __name__ == "__main__":
    words = sys.argv[1:] or ["cost", "latency"]
    for word in words:
        if word.isdigit():
            continue
        if word == "endurance":
            endurance(int(words[words.index(word) + 1]))
        else:
            BENCHES[word]()
