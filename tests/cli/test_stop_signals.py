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
