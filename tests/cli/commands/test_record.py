"""`skinbus record`: what was on the bus is in the file, however the recording ends."""

import os
import re
import signal
import threading

import pytest

from skinbus.bus.pythoncan import PythonCanBus
from skinbus.can.candump import CandumpReader
from skinbus.can.frame import BRS, EXTENDED, FD, Frame
from tests.cli.invoke import refused, run
from tests.cli.patience import PATIENCE_S


class Speaker:
    """Sends frames again and again while it is open; ends what records in ``folder`` once it has many."""

    def __init__(self, frames, interface="virtual", *channels, folder=None):
        self.frames = frames
        self.folder = folder
        self.buses = [PythonCanBus(interface, channel, fd=True) for channel in channels]
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self.run)

    def run(self):
        while not self.stop.wait(0.01):
            for bus in self.buses:
                bus.send(self.frames)
            if self.folder and any(log.stat().st_size > 1000 for log in self.folder.iterdir()):
                self.folder = None
                os.kill(os.getpid(), signal.SIGINT)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *error):
        self.stop.set()
        self.thread.join()
        for bus in self.buses:
            bus.close()


def test_all_frames_of_all_channels_are_recorded_and_reported(tmp_path):
    log = tmp_path / "field.log"
    one, two = f"record-{os.getpid()}-1", f"record-{os.getpid()}-2"
    frames = [
        Frame(0x181, b"\x01\x02"),
        Frame(0x12345, b"", 0, EXTENDED),
        Frame(0x182, b"\x03" * 12, 0, FD | BRS),
    ]
    with Speaker(frames, "virtual", one, two, folder=tmp_path):
        result = run("record", log, "--interface", "virtual", "-c", one, "-c", two, "--seconds", PATIENCE_S)
    first, stopping, last = result.splitlines()
    assert stopping == "stopping"
    assert first == f"recording virtual {one}, virtual {two} to {log}; Ctrl-C stops"
    reader = CandumpReader(log)
    read = list(reader)
    assert (reader.n_strange, reader.is_cut) == (0, False)
    assert re.match(rf"{re.escape(str(log))}: {len(read)} frames in \d+\.\d", last)
    for channel in (one, two):
        seen = [frame._replace(t_ns=0) for frame, name in read if name == channel]
        assert len(seen) > 2 * len(frames)
        begin = seen.index(frames[0])  # it may have begun to listen in the middle of them
        assert begin < len(frames)
        assert seen[begin : begin + len(frames)] == frames
    times = [frame.t_ns for frame, _ in read]
    assert times == sorted(times)
    assert times[0] > 1_700_000_000 * 10**9


@pytest.mark.slow
def test_a_recording_that_is_killed_has_whole_lines_only(skinbus, group, tmp_path):
    log = tmp_path / "field.log"
    with Speaker([Frame(k, bytes(8)) for k in range(50)], "udp_multicast", group):
        process = skinbus("record", str(log), "--interface", "udp_multicast", "--channel", group)
        timer = threading.Timer(PATIENCE_S, process.kill)
        timer.start()
        assert process.stdout.readline().startswith("recording udp_multicast")
        while log.stat().st_size < 100_000 and timer.is_alive():
            timer.join(0.01)
        timer.cancel()
        process.kill()
        process.communicate(timeout=PATIENCE_S)
    reader = CandumpReader(log)
    assert len(list(reader)) > 1000
    assert reader.n_strange == 0


def test_no_bus_leaves_no_file(tmp_path):
    assert "no-such-can" in refused("record", tmp_path / "new.log", "--channel", "no-such-can")
    assert not list(tmp_path.iterdir())
