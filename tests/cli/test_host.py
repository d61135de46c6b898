"""The host of a core ends it whole: its last frames are sent before the command goes on."""

import os
import signal
import threading

from skinbus.bus.pythoncan import PythonCanBus
from skinbus.can.core import NEVER, Core, Step
from skinbus.can.frame import Frame
from skinbus.cli.host import Host


class Idle(Core):
    """A core that does nothing."""

    cob_ids = frozenset()

    def step(self, now_ns, frames):
        return Step((), (), NEVER)


def test_ctrl_c_waits_for_the_farewell():
    said, patience = [], threading.Event()

    def final_frames(now_ns):
        patience.wait(0.5)  # longer than a command takes to end
        return [Frame(0x000, bytes([128, 0]))]

    with PythonCanBus("virtual", "final_frames") as observer:
        host = Host(
            Idle(),
            lambda: PythonCanBus("virtual", "final_frames"),
            final_frames=final_frames,
            say=said.append,
        )
        with host:
            host.wait(None, 0.01, lambda: os.kill(os.getpid(), signal.SIGINT))
        assert [frame.data for frame in observer.receive(0.0)] == [bytes([128, 0])]
    assert said == ["stopping"]
    assert host.report.n_sent == 1
