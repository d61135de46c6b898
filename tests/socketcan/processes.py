"""Commands on a real interface: ended cleanly, and the master's objects as a client sees them."""

import contextlib
import signal

import canopen

from tests.cli.patience import PATIENCE_S, wait_until
from tests.socketcan.can_rig import EDS


def end(process):
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0 or "silent: " in out, out  # a busy machine held patches up at the end
    assert "Traceback" not in out
    return out


@contextlib.contextmanager
def master_on(channel):
    """The master's objects, as any CANopen client sees them."""
    network = canopen.Network()
    network.connect(interface="socketcan", channel=channel)
    node = network.add_node(127, str(EDS / "skin-master.eds"))
    node.sdo.RESPONSE_TIMEOUT = 2.0  # s; the tenths of its default pass while another process has the CPU
    try:
        yield node.sdo
    finally:
        network.disconnect()


def wait_for(happened):
    """Wait until something is so; a master that is not there yet does not answer."""

    def so():
        with contextlib.suppress(canopen.SdoCommunicationError):
            return happened()

    wait_until(so, 0.05)


def wait_for_patches(master, n):
    """Wait for a cycle in which n patches sent all their readings."""
    wait_for(lambda: master["Cycle"]["Patches alive"].raw == n)
