"""The heartbeat consumer: watches the nodes named in 0x1016, each from its first heartbeat on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from skinbus.can.core import NEVER
from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.node.context import NS_PER_MS, Context, Handlers, Part
from skinbus.node.dictionary import SdoAbort
from skinbus.node.nmt import Service
from skinbus.objects.cia import HEARTBEAT_BASE, HEARTBEAT_CONSUMER, MAX_NODE_ID, AbortCode, EmcyCode, NmtState

NODE_STATES = frozenset(NmtState)


@dataclass(slots=True)
class Watched:
    """One node of 0x1016; ``due_ns`` is NEVER before its first heartbeat, and after a boot-up."""

    node_id: int
    time_ns: int
    due_ns: int = NEVER


class HeartbeatConsumer(Part):
    """Reports which of the watched nodes are lost, and which are back.

    A loss is an error of this device (0x8130, with the node-ID as data) until a heartbeat or boot-up comes.
    """

    kind = Service.ERROR_CONTROL

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.nodes: dict[int, Watched] = {}
        self._subs = self.dictionary.layout.subs(HEARTBEAT_CONSUMER)
        self.dictionary.rules[HEARTBEAT_CONSUMER] = self._check
        self.dictionary.watchers[HEARTBEAT_CONSUMER] = self._changed

    def configure(self) -> None:
        """Take over 0x1016, as after a reset: all nodes are unknown."""
        self.nodes = self._read()
        self.wake_ns = NEVER

    def handlers(self) -> Handlers:
        """The error control identifiers of the watched nodes."""
        return {HEARTBEAT_BASE + n: partial(self._receive, node) for n, node in self.nodes.items()}

    def tick(self) -> None:
        """Find the nodes that have been silent for too long."""
        self.wake_ns = NEVER
        lost = False
        for node in self.nodes.values():
            if self.context.now_ns >= node.due_ns:
                node.due_ns = NEVER
                self.context.report(EventKind.HEARTBEAT_LOST, "", node.node_id)
                self.emcy.raise_error(EmcyCode.HEARTBEAT, data=bytes((node.node_id,)))
                lost = True
            self.wake_ns = min(self.wake_ns, node.due_ns)
        if lost:
            self.context.on_loss()

    def _receive(self, node: Watched, frame: Frame) -> None:
        state = frame.data[0] & 0x7F if len(frame.data) == 1 else None
        if state not in NODE_STATES:
            self.context.drop(frame, "a heartbeat is one byte, a state of NMT")
            return
        if state == NmtState.INITIALISING:
            node.due_ns = NEVER  # the next heartbeat may be long in coming
        else:
            node.due_ns = self.context.now_ns + node.time_ns
            self.wake_ns = min(self.wake_ns, node.due_ns)
        if self.emcy.clear_error(EmcyCode.HEARTBEAT, bytes((node.node_id,))):
            self.context.report(EventKind.HEARTBEAT_BACK, "", node.node_id)

    def _read(self) -> dict[int, Watched]:
        nodes = {}
        for sub in self._subs:
            node_id, time_ms = _split(self.values.number(HEARTBEAT_CONSUMER, sub))
            if node_id:
                nodes[node_id] = Watched(node_id, time_ms * NS_PER_MS)
        return nodes

    def _changed(self, sub: int) -> None:
        """Keep what is known of the nodes that stay as they were."""
        nodes = self._read()
        for node_id, old in self.nodes.items():
            if node_id in nodes and nodes[node_id].time_ns == old.time_ns:
                nodes[node_id] = old
            else:
                self.emcy.clear_error(EmcyCode.HEARTBEAT, bytes((node_id,)))
        self.nodes = nodes
        self.context.listen()

    def _check(self, sub: int, data: bytes) -> None:
        """CiA 301, 7.5.2.18: the number of entries stays, and no node is there twice."""
        if sub == 0:
            raise SdoAbort(AbortCode.READ_ONLY)
        value = int.from_bytes(data, "little")
        node_id, _ = _split(value)
        if value >> 24:
            raise SdoAbort(AbortCode.VALUE_INVALID)
        for other in self._subs:
            taken, _ = _split(self.values.number(HEARTBEAT_CONSUMER, other))
            if node_id and other != sub and taken == node_id:
                raise SdoAbort(AbortCode.INCOMPATIBLE)


def _split(value: int) -> tuple[int, int]:
    """Node-ID and time (ms) of an entry; (0, 0) when it is not used."""
    node_id, time_ms = value >> 16 & 0xFF, value & 0xFFFF
    return (node_id, time_ms) if time_ms and 1 <= node_id <= MAX_NODE_ID else (0, 0)
