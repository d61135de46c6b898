"""However a command is asked to end, the end is clean: the last frames go out, the summary is written."""

import json
import os
import signal
import threading

import pytest

from skinbus.bus.pythoncan import PythonCanBus
from skinbus.can.core import NEVER, Core, Step
from skinbus.can.frame import Frame
from skinbus.cli.host import Host
from skinbus.cli.stop_signals import Ending
from skinbus.objects import cia
from tests.cli.patience import PATIENCE_S, complaints

ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
FAREWELL = Frame(cia.NMT_COMMAND_ID, bytes([cia.NmtCommand.PRE_OPERATIONAL, 0]))


class Idle(Core):
    """A core that does nothing for ever."""

    cob_ids = frozenset()

    def step(self, now_ns, frames):
        return Step((), (), NEVER)


def hear(bus, cob_id, is_meant=lambda data: True):
    """Return when a frame with an identifier, and with the data that are meant, is heard."""
    ended = threading.Event()
    timer = threading.Timer(PATIENCE_S, ended.set)
    timer.start()
    try:
        while not ended.is_set():
            for frame in bus.receive(0.5):
                if frame.can_id == cob_id and is_meant(frame.data):
                    return
    finally:
        timer.cancel()
    raise AssertionError(f"no frame 0x{cob_id:03X}")


@pytest.mark.parametrize("number", ENDS)
def test_a_signal_in_a_wait_ends_it_and_the_farewell_goes_out(number):
    before = signal.getsignal(number)
    said = []
    channel = f"ending-{number}"
    with PythonCanBus("virtual", channel) as ear:
        host = Host(
            Idle(),
            lambda: PythonCanBus("virtual", channel),
            final_frames=lambda t: [FAREWELL],
            say=said.append,
        )
        with host:
            host.wait(None, 0.01, lambda: os.kill(os.getpid(), number))
            os.kill(os.getpid(), number)  # a second one does not cut the final_frames short
        assert [frame[:2] for frame in ear.receive(0.0)] == [FAREWELL[:2]]
    assert host.report.n_sent == 1
    assert said == ["stopping"]
    assert signal.getsignal(number) is before


def test_a_signal_that_is_ignored_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Ending() as ending:
            os.kill(os.getpid(), signal.SIGHUP)
        assert not ending.asked
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_master_leaves_the_patches_pre_operational_and_its_summary(
    skinbus, group, tmp_path, number
):
    bus = ("--interface", "udp_multicast", "--channel", group)
    file = tmp_path / "run.json"
    sim = skinbus("sim", "pad", *bus)
    assert sim.stdout.readline()
    with PythonCanBus("udp_multicast", group) as ear:
        run = skinbus("run", "pad", *bus, "--json", str(file))
        hear(ear, 0x1FF, lambda summary: summary[2] == 1)  # a cycle with the readings of the patch
        run.send_signal(number)
        out, err = run.communicate(timeout=PATIENCE_S)
        hear(ear, FAREWELL.can_id, lambda data: data == FAREWELL.data)
    summary = json.loads(file.read_text())
    assert summary["patches"] == 1
    # 1: a busy machine has held the patch up at the end.
    assert (run.returncode, complaints(err)) == (int(summary["alive"] == 0), []), out
    sim.send_signal(number)
    out, err = sim.communicate(timeout=PATIENCE_S)
    assert (sim.returncode, complaints(err)) == (0, [])
    assert "frames in" in out
    assert "\n0 frames in" not in out


@pytest.mark.slow
def test_a_stopped_monitor_has_printed_each_cycle(skinbus, group):
    bus = ("--interface", "udp_multicast", "--channel", group)
    monitor = skinbus("monitor", "forearm", *bus, "--json-lines")
    summary = Frame(0x1FF, bytes([7, 1, 24, 0, 200, 0, 50, 0]))
    contact = Frame(0x681, bytes([3, 0x20]) + (778).to_bytes(2, "little") + bytes([100, 0, 0x20, 3]))
    lines = []
    reader = threading.Thread(target=lambda: lines.append(monitor.stdout.readline()), daemon=True)
    reader.start()
    with PythonCanBus("udp_multicast", group) as master:
        while reader.is_alive():
            master.send([summary, contact])
            reader.join(0.1)  # the monitor may not be on the bus yet
    monitor.send_signal(signal.SIGTERM)
    _, err = monitor.communicate(timeout=PATIENCE_S)
    assert (monitor.returncode, complaints(err)) == (0, [])
    seen = {"id": 3, "link": "forearm", "state": "held", "s_mm": 77.8, "a_mm": 10.0, "force_n": 8.0}
    told = json.loads(lines[0])
    assert told == {
        "sync": 7,
        "level": None,  # this summary does not say
        "latency_us": 500,
        "flags": [],
        "contacts": [seen],
    }
