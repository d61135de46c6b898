"""`skinbus record` beside candump on a kernel's CAN: the same frames, also across an outage."""

import signal
import subprocess
from pathlib import Path

from skinbus.bus.socketcan import SocketCanBus
from skinbus.can.candump import CandumpReader
from skinbus.can.frame import BRS, FD, Frame
from tests.cli.patience import PATIENCE_S
from tests.socketcan.can_rig import set_up
from tests.socketcan.frames import EVERY_KIND
from tests.socketcan.processes import wait_for

LONG = Frame(0x185, bytes(range(32)), flags=FD | BRS)


def recording(start, channel, log):
    """A recorder that listens."""
    recorder = start("record", str(log), "--channel", channel)
    assert recorder.stdout.readline() == f"recording socketcan {channel} to {log}; Ctrl-C stops\n"
    return recorder


def end(process, number=signal.SIGTERM):
    process.send_signal(number)
    out, _ = process.communicate(timeout=PATIENCE_S)
    assert "Traceback" not in out
    return out


def frames_in(path):
    return [frame._replace(t_ns=0) for frame, _ in CandumpReader(path)]


def n_lines(path):
    return path.read_text().count("\n") if path.exists() else 0


def test_every_kind_of_frame_is_recorded_as_candump_does(start, channel, tmp_path):
    mine, its = tmp_path / "mine.log", tmp_path / "its.log"
    sent = [*EVERY_KIND, LONG] * 50
    recorder = recording(start, channel, mine)
    listeners = Path("/proc/net/can/rcvlist_all")
    with its.open("w") as file, SocketCanBus(channel, fd=True) as sender:
        before = listeners.read_text().count(f" {channel} ")
        candump = subprocess.Popen(["candump", "-L", "-r", "8388608", channel], stdout=file)
        try:
            wait_for(lambda: listeners.read_text().count(f" {channel} ") > before)
            assert sender.send(sent) == len(sent)
            wait_for(lambda: n_lines(mine) >= len(sent) and n_lines(its) >= len(sent))
        finally:
            candump.kill()
            candump.wait()
    assert f"{mine}: {len(sent)} frames in " in end(recorder)
    assert recorder.returncode == 0
    assert frames_in(mine) == frames_in(its) == sent
    times = [[frame.t_ns for frame, _ in CandumpReader(path)] for path in (mine, its)]
    assert max(abs(a - b) for a, b in zip(*times, strict=True)) < 5_000_000


def test_a_recording_outlives_an_interface_that_goes_down(start, channel, tmp_path):
    log = tmp_path / "field.log"
    recorder = recording(start, channel, log)
    with SocketCanBus(channel) as sender:
        sender.send([Frame(1)])
    wait_for(lambda: n_lines(log) == 1)
    for n in (2, 3):
        set_up(channel, False)
        assert "bus-lost" in recorder.stdout.readline()
        set_up(channel, True)
        assert "bus-back" in recorder.stdout.readline()
        with SocketCanBus(channel) as sender:
            sender.send([Frame(n)])
        wait_for(lambda n=n: n_lines(log) == n)
    assert "3 frames in " in (out := end(recorder, signal.SIGINT))
    assert "the bus was lost 2 times" in out
    assert [frame.can_id for frame in frames_in(log)] == [1, 2, 3]
