"""However a command is asked to end, the end is clean: the last frames go out."""

import os
import signal

import pytest

from skinbus.bus.pythoncan import PythonCanBus
from skinbus.can.frame import Frame
from skinbus.cli.host import Host
from skinbus.cli.stop_signals import Ending
from skinbus.objects import cia
from skinbus.skin.addresses import BusAddress
from tests.bus.cores import Talker

ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
FAREWELL = Frame(cia.NMT_COMMAND_ID, bytes([cia.NmtCommand.PRE_OPERATIONAL, 0]))


class Idle(Talker):
    """A core that says nothing until its end."""

    def last_frames(self, now_ns):
        return [FAREWELL]


@pytest.mark.parametrize("number", ENDS)
def test_a_signal_in_a_wait_ends_it_and_the_farewell_goes_out(number):
    before = signal.getsignal(number)
    said = []
    channel = f"ending-{number}"
    with PythonCanBus("virtual", channel) as ear:
        host = Host(Idle(), [BusAddress("virtual", channel, 1_000_000)], say=said.append)
        with host:
            host.wait(None, 0.01, lambda: os.kill(os.getpid(), number))
            os.kill(os.getpid(), number)  # a second one does not cut the last frames short
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
