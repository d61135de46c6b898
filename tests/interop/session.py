"""Our SDO client on a wire with a server, to be used as if it were a function call."""

from skinbus.can.core import Core, Step
from skinbus.can.frame import Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.node.sdo_client import SdoClient

STEP_NS = 1_000_000
PATIENCE_STEPS = 2000
START_ALL = Frame(0x000, b"\x01\x00")
SYNC = Frame(0x080)


class Client(Core):
    """The SDO client as a core, with a few frames of its own to send."""

    cob_ids = frozenset()

    def __init__(self, node_id):
        self.sdo = SdoClient(node_id)
        self.cob_ids = frozenset({self.sdo.answer_id})
        self.waiting = []

    def step(self, now_ns, frames):
        """Pass time and frames on."""
        waiting, self.waiting = self.waiting, []
        return Step([*waiting, *self.sdo.step(now_ns, frames)], (), self.sdo.wake_ns)


class SdoSession:
    """A client of ``node_id`` on a wire of its own, or on a given one."""

    def __init__(self, node_id, server=None, wire=None):
        self.wire = wire or VirtualBus()
        self.frames = []
        self.wire.tap(self.frames.append)
        if server is not None:
            self.wire.attach(server)
        self.client = Client(node_id)
        self.port = self.wire.attach(self.client)
        self.wire.run(self.wire.now_ns + STEP_NS)

    def read(self, index, sub):
        """The bytes of an entry; SdoAborted if it is refused."""
        return self._run(self.client.sdo.start_read, index, sub)

    def write(self, index, sub, data):
        """Set an entry; SdoAborted if it is refused."""
        self._run(self.client.sdo.start_write, index, sub, data)

    def send(self, *frames):
        """Send frames and give them a few milliseconds."""
        self.client.waiting += frames
        self.wire.wake(self.port)
        self.wire.run(self.wire.now_ns + 5 * STEP_NS)

    def frames_of_two_syncs(self):
        """What is on the wire when all nodes are started and two SYNCs follow."""
        self.send(START_ALL)
        n_before = len(self.frames)
        self.send(SYNC)
        self.send(SYNC)
        return self.frames[n_before:]

    def _run(self, start, *arguments):
        start(*arguments)
        self.wire.wake(self.port)
        for _ in range(PATIENCE_STEPS):
            self.wire.run(self.wire.now_ns + STEP_NS)
            if self.client.sdo.result is not None:
                return self.client.sdo.result.unwrap()
        raise AssertionError("the transfer did not end")
