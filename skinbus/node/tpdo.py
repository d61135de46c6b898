"""The TPDO engine: on SYNC, on events, on a timer, never inside the inhibit time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from skinbus.can.core import NEVER
from skinbus.can.fd import CLASSIC_BYTES
from skinbus.can.frame import LONG, Frame
from skinbus.node.context import NS_PER_100US, NS_PER_MS, Context, Part
from skinbus.node.mapping import packer
from skinbus.node.pdo_rules import Pdo
from skinbus.objects.cia import SYNC_COUNTER_OVERFLOW, SYNC_WINDOW, EmcyCode, NmtState, TransmissionType
from skinbus.objects.pdo import Direction, pdo_numbers, readings_in
from skinbus.objects.profile import SAMPLE_STATUS, has, index_of

_make_frame = tuple.__new__

WINDOW_TAG = SYNC_WINDOW.to_bytes(2, "little")
"""Data of the EMCY about the synchronous window."""


class Tpdo(Pdo):
    """One TPDO, and where it stands."""

    direction = Direction.TPDO
    pack: Callable[[], bytes] = bytes
    # The rest lives while OPERATIONAL.
    countdown = 0  # SYNCs to the next transmission
    awaits_start = False  # no SYNC with the start value seen yet
    requested = False
    free_ns = 0  # end of the inhibit time
    due_ns = NEVER  # end of the event time

    def compile(self) -> None:
        """Take over the values as they stand."""
        super().compile()
        self.pack = packer(self.values, self.map) if self.map.valid else bytes

    @property
    def by_event(self) -> bool:
        """Types 254 and 255: sent outside SYNC."""
        return self.map.transmission_type >= TransmissionType.EVENT_MANUFACTURER

    @property
    def cyclic(self) -> bool:
        """Types 1 to 240: sent every so many SYNCs."""
        return TransmissionType.SYNC_ACYCLIC < self.map.transmission_type <= TransmissionType.SYNC_MAX

    def next_event_ns(self, now_ns: int) -> int:
        """When the event timer, started now, will ask for the PDO."""
        return now_ns + self.map.event_timer_ms * NS_PER_MS if self.map.event_timer_ms else NEVER


class TpdoService(Part):
    """All TPDOs of a device."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.on_change: Callable[[], None] = lambda: None
        """Called when a PDO was reconfigured."""
        self.on_sent: Callable[[Tpdo], None] = lambda pdo: None
        """Called after an event-driven or acyclic TPDO was sent."""
        self.runs_freely = False
        """Whether any PDO with readings is sent on an event or by its timer now."""
        self._every_sync: list[tuple[int, Callable[[], bytes], int]] = []
        self._some_syncs: list[Tpdo] = []
        self._by_event: list[Tpdo] = []
        self._is_withheld = False
        od = self.dictionary.layout.od
        self._status = index_of(od, SAMPLE_STATUS) if has(od, SAMPLE_STATUS) else None
        numbers = pdo_numbers(od, Direction.TPDO)
        self.pdos = {number: Tpdo(context, number, partial(self._changed, number)) for number in numbers}

    def configure(self) -> None:
        """Compile all PDOs from the values, as after a reset."""
        for pdo in self.pdos.values():
            pdo.compile()
        self._sort()

    def enter(self, state: NmtState) -> None:
        """PDOs begin anew with every entry to OPERATIONAL."""
        self._sort()
        if state is NmtState.OPERATIONAL:
            for pdo in self.pdos.values():
                self._start(pdo)
        self._plan()

    def withhold(self, is_withheld: bool) -> None:
        """Send no readings from now on, or again; where the status of samples is mapped it says it all."""
        self._is_withheld = is_withheld
        self._sort()
        self._plan()

    def request(self, number: int) -> None:
        """Ask for a TPDO that is sent on events now.

        254, 255: as soon as the inhibit time allows; 0: with the next SYNC.
        """
        pdo = self.pdos[number]
        if pdo.map.valid and not pdo.cyclic and self.context.state is NmtState.OPERATIONAL:
            pdo.requested = True
            if pdo.by_event:
                self.wake_ns = min(self.wake_ns, pdo.free_ns)

    def on_sync(self, counter: int, *, in_window: bool = True) -> None:
        """Send what this SYNC asks for, sampled now; ``counter`` is 0 when SYNC has none.

        After the synchronous window (0x1007) nothing is sent: it would be taken for that of the next SYNC.
        """
        if not in_window:
            self._discard(counter)
            return
        self.emcy.clear_error(EmcyCode.COMMUNICATION, WINDOW_TAG)
        now_ns = self.context.now_ns
        self.context.out += [
            _make_frame(Frame, (cob_id, pack(), now_ns, flags, 0)) for cob_id, pack, flags in self._every_sync
        ]
        for pdo in self._some_syncs:
            if pdo.map.transmission_type == TransmissionType.SYNC_ACYCLIC:
                if pdo.requested:
                    pdo.requested = False
                    self._send(pdo)
                    self.on_sent(pdo)
                continue
            if pdo.awaits_start:
                if counter != pdo.map.sync_start:
                    continue
                pdo.awaits_start = False
            pdo.countdown -= 1
            if pdo.countdown <= 0:
                pdo.countdown = pdo.map.transmission_type
                self._send(pdo)

    def tick(self) -> None:
        """Send event-driven TPDOs that are asked for or due."""
        now_ns = self.context.now_ns
        for pdo in self._by_event:
            if (pdo.requested or now_ns >= pdo.due_ns) and now_ns >= pdo.free_ns:
                pdo.requested = False
                pdo.free_ns = now_ns + pdo.map.inhibit_100us * NS_PER_100US
                pdo.due_ns = pdo.next_event_ns(now_ns)
                self._send(pdo)
                self.on_sent(pdo)
        self._plan()

    def _discard(self, counter: int) -> None:
        """Count a SYNC whose window has passed; what it asked for is an error, and is not made up for."""
        if self._every_sync or self._some_syncs:
            self.emcy.raise_error(EmcyCode.COMMUNICATION, data=WINDOW_TAG)
        for pdo in self._some_syncs:
            pdo.requested = False
            pdo.awaits_start &= counter != pdo.map.sync_start
            if pdo.cyclic and not pdo.awaits_start:
                pdo.countdown = pdo.countdown - 1 or pdo.map.transmission_type

    def _send(self, pdo: Tpdo) -> None:
        self.context.send(pdo.map.cob_id, pdo.pack())

    def _plan(self) -> None:
        """Set the next time at which something has to be sent."""
        self.wake_ns = NEVER
        for pdo in self._by_event:
            due_ns = pdo.free_ns if pdo.requested else max(pdo.due_ns, pdo.free_ns)
            self.wake_ns = min(self.wake_ns, due_ns)

    def _changed(self, number: int, sub: int) -> None:
        """Take over a parameter written at run time."""
        pdo = self.pdos[number]
        before = pdo.map
        pdo.compile()
        rhythm = pdo.map.transmission_type, pdo.map.event_timer_ms
        if not before.valid or rhythm != (before.transmission_type, before.event_timer_ms):
            self._start(pdo)
        self._sort()
        self._plan()
        self.on_change()

    def _start(self, pdo: Tpdo) -> None:
        pdo.countdown = pdo.map.transmission_type
        pdo.awaits_start = bool(pdo.map.sync_start and self.values.number(SYNC_COUNTER_OVERFLOW, 0))
        pdo.requested = False
        pdo.free_ns = 0
        pdo.due_ns = pdo.next_event_ns(self.context.now_ns)

    def _sort(self) -> None:
        """Put each PDO in the list it is served from; nothing is served outside OPERATIONAL."""
        self._every_sync, self._some_syncs, self._by_event = [], [], []
        self.runs_freely = False
        if self.context.state is not NmtState.OPERATIONAL:
            return
        sent = [pdo for pdo in self.pdos.values() if pdo.map.valid]
        mapped = [(entry.index, entry.sub) for pdo in sent for entry in pdo.map.entries]
        if self._is_withheld and self._status not in mapped:
            sent = [pdo for pdo in sent if not readings_in(pdo.map)]
        for pdo in sent:
            if pdo.by_event:
                self._by_event.append(pdo)
                self.runs_freely |= bool(readings_in(pdo.map))
            elif pdo.map.transmission_type == 1 and not pdo.map.sync_start:
                flags = LONG if pdo.map.length > CLASSIC_BYTES else 0
                self._every_sync.append((pdo.map.cob_id, pdo.pack, flags))
            else:
                self._some_syncs.append(pdo)
