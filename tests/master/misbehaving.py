"""Boards that misbehave, and another tool that changes them behind the master's back."""

import heapq

from skinbus.can.core import NEVER, Core, Step
from skinbus.node.sdo_client import SdoClient
from skinbus.objects import cia

MS = 1_000_000
SAVE = cia.SIGNATURE_SAVE.to_bytes(4, "little")


class Tool(Core):
    """A core that downloads to one node, one value after the other; ``faults`` are the transfers refused."""

    cob_ids = frozenset()

    def __init__(self, node_id, writes):
        self.sdo = SdoClient(node_id)
        self.cob_ids = frozenset({cia.SDO_SERVER_BASE + node_id})
        self.left = list(writes)
        self.faults = []

    @property
    def is_done(self):
        return not self.left and not self.sdo.busy

    def step(self, now_ns, frames):
        out = self.sdo.step(now_ns, frames)
        if not self.sdo.busy:
            if self.sdo.result is not None and self.sdo.result.abort:
                self.faults.append(self.sdo.result)
            if self.left:
                self.sdo.start_write(*self.left.pop(0))
                out += self.sdo.step(now_ns)
        return Step(out, (), self.sdo.wake_ns)


def swapped_mappings(device):
    """Downloads that swap what TPDO 1 and 2 carry and store that, as a tool does that takes care."""
    writes = []
    for index, other in ((0, 1), (1, 0)):
        cob_id = device.get(cia.TPDO_COMMUNICATION + index, 1)
        n = device.get(cia.TPDO_MAPPING + index, 0)
        writes += [
            (cia.TPDO_COMMUNICATION + index, 1, (cob_id | cia.COB_ID_INVALID).to_bytes(4, "little")),
            (cia.TPDO_MAPPING + index, 0, b"\0"),
            *(
                (cia.TPDO_MAPPING + index, k, device.get(cia.TPDO_MAPPING + other, k).to_bytes(4, "little"))
                for k in range(1, n + 1)
            ),
            (cia.TPDO_MAPPING + index, 0, bytes([n])),
            (cia.TPDO_COMMUNICATION + index, 1, cob_id.to_bytes(4, "little")),
        ]
    return [*writes, (cia.STORE_PARAMETERS, 1, SAVE)]


def all_pdos_off(device):
    """Downloads that switch all TPDOs off: the heartbeat goes on, readings do not come."""
    return [
        (index, 1, (device.get(index, 1) | cia.COB_ID_INVALID).to_bytes(4, "little"))
        for index in range(cia.TPDO_COMMUNICATION, cia.TPDO_COMMUNICATION + 4)
    ]


class Wrapped(Core):
    """A board, whose frames a test may change."""

    def __init__(self, device):
        self.device = device

    def cob_ids_on(self, bus):
        return self.device.cob_ids_on(bus)

    def step(self, now_ns, frames):
        return self.device.step(now_ns, frames)


class Stubborn(Wrapped):
    """A board that takes another value of an object and keeps its own."""

    def __init__(self, device, *value):
        super().__init__(device)
        self.value = value

    def step(self, now_ns, frames):
        step = self.device.step(now_ns, frames)
        self.device.set(*self.value)
        return step


class Delayed(Wrapped):
    """Boards whose frames pass through ``later(now_ns, frame)``: those to send for one, and when (ns)."""

    def __init__(self, device):
        super().__init__(device)
        self._waiting, self._n = [], 0

    def later(self, now_ns, frame):
        return [(now_ns, frame)]

    def step(self, now_ns, frames):
        step = self.device.step(now_ns, frames)
        for frame in step.frames:
            if (
                frame.can_id & ~0x7F == cia.HEARTBEAT_BASE and frame.data == b"\0"
            ):  # what it had to send is gone
                self._waiting = [entry for entry in self._waiting if (entry[2].can_id ^ frame.can_id) & 0x7F]
                heapq.heapify(self._waiting)
            for t_ns, out in self.later(now_ns, frame):
                self._n += 1
                heapq.heappush(self._waiting, (round(t_ns), self._n, out))
        due = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            due.append(heapq.heappop(self._waiting)[2])
        return Step(due, step.events, min([step.wake_ns, *(entry[0] for entry in self._waiting[:1])]))


class Late(Delayed):
    """It sends everything a little later than another board does: no frames of both meet on the wire."""

    def later(self, now_ns, frame):
        return [(now_ns + 400_000, frame)]


class Rebooting(Wrapped):
    """It reboots some time after each start."""

    def __init__(self, device, after_ms):
        super().__init__(device)
        self.after_ns = after_ms * MS
        self.reboot_ns = NEVER
        self.n_starts = 0

    def step(self, now_ns, frames):
        before = self.device.nmt_state
        if now_ns >= self.reboot_ns:
            self.reboot_ns = NEVER
            self.device.command(cia.NmtCommand.RESET_NODE)
        step = self.device.step(now_ns, frames)
        if before is not cia.NmtState.OPERATIONAL and self.device.nmt_state is cia.NmtState.OPERATIONAL:
            self.n_starts += 1
            self.reboot_ns = now_ns + self.after_ns
        return step._replace(wake_ns=min(step.wake_ns, self.reboot_ns))
