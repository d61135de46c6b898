"""One CANopen device: the services put together, stepped with time and frames."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import canopen
import numpy.typing as npt

from skinbus.can.core import Core, Step
from skinbus.can.event import EventKind
from skinbus.can.frame import REMOTE_ID, RTR, CobIds, Frame, Frames
from skinbus.errors import LocalProtocolError
from skinbus.node.context import Context, Handlers
from skinbus.node.dictionary import WriteHook
from skinbus.node.emcy import EmcyService
from skinbus.node.guard import GuardService
from skinbus.node.heartbeat import HeartbeatProducer
from skinbus.node.heartbeat_consumer import HeartbeatConsumer
from skinbus.node.layout import ImageLayout, key_of
from skinbus.node.lss import UNCONFIGURED, LssSlave
from skinbus.node.nmt import SERVICES, TRANSITIONS, Service, command_for
from skinbus.node.node_guarding import NodeGuarding
from skinbus.node.program import ProgramService
from skinbus.node.rpdo import RpdoService
from skinbus.node.sdo_server import SdoServer
from skinbus.node.storage import AREAS, COMMUNICATION, Storage, StorageService
from skinbus.node.sync import SyncService
from skinbus.node.tpdo import TpdoService
from skinbus.node.triggers import AnalogueTriggers
from skinbus.node.values import Values
from skinbus.node.verify import VerifyService
from skinbus.objects.cia import (
    DEVICE_TYPE,
    ERROR_BEHAVIOR,
    ERROR_BEHAVIOR_COMMUNICATION,
    ERROR_REGISTER,
    IDENTITY,
    MAX_NODE_ID,
    NMT_COMMAND_ID,
    EmcyCode,
    NmtCommand,
    NmtState,
)
from skinbus.objects.profile import SAMPLE_COUNTER, SAMPLE_STATUS, SampleStatus, has, index_of

MANDATORY = (DEVICE_TYPE, ERROR_REGISTER, IDENTITY)
"""Objects that every device has (CiA 301, 7.5.1)."""
FIRST_APPLICATION_OBJECT = 0x2000
ON_COMMUNICATION_ERROR = {0: NmtState.PRE_OPERATIONAL, 2: NmtState.STOPPED}
"""State entered from OPERATIONAL for a value of 0x1029:01; others change nothing."""


class Device(Core):
    """A device described by an object dictionary.

    Args:
        od: description and defaults; shared, never written.
        node_id: 1..127, or 255: unconfigured, LSS gives one.
        storage: keeps parameters (0x1010) and the node-ID given by LSS over a restart; none when None.

    The first ``step`` boots it; what the host has set before is the start, a reset brings the defaults back.
    Inputs that the host writes to the image are looked at, for events on a change, with every ``step``.

    Hooks, all optional:
        on_sync(now_ns, counter): before TPDOs are sampled, after RPDOs took effect; 0 = no counter.
        on_write(index, sub, value): before a write from the bus; an abort code refuses it.
        on_nmt(state): a state was entered.
    """

    cob_ids: CobIds = frozenset()
    """Identifiers that it listens to in its present state."""

    def __init__(
        self,
        od: canopen.ObjectDictionary,
        node_id: int,
        *,
        storage: Storage | None = None,
    ) -> None:
        if not 1 <= node_id <= MAX_NODE_ID and node_id != UNCONFIGURED:
            raise ValueError(f"node_id: wanted 1..{MAX_NODE_ID} or {UNCONFIGURED}, got {node_id}")
        missing = [f"0x{index:04X}" for index in MANDATORY if index not in od]
        if missing:
            raise ValueError(f"the object dictionary lacks {', '.join(missing)}")
        self.layout = ImageLayout(od, node_id)
        self.values = Values(self.layout)
        for entry in self.layout.entries.values():
            self.values.store(entry, self.values.default(entry, node_id))
        self.on_sync: Callable[[int, int], None] = lambda now_ns, counter: None
        self.on_nmt: Callable[[NmtState], None] = lambda state: None
        self._context = context = Context(self.values, node_id)
        context.listen, context.on_loss = self._listen, self.communication_error
        self._emcy = context.emcy = EmcyService(context)
        self._heartbeat = HeartbeatProducer(context)
        self._consumer = HeartbeatConsumer(context)
        self._guarding = NodeGuarding(context)
        self._sdo = SdoServer(context)
        self._sync = SyncService(context, self._synchronise)
        self._rpdo = RpdoService(context, self._sync.in_window)
        self._tpdo = TpdoService(context)
        self._triggers = AnalogueTriggers(context, self._tpdo)
        self._guard = GuardService(context, self._tpdo)
        self._storage = StorageService(context, storage)
        self._program = ProgramService(context, storage)
        self._verify = VerifyService(context)
        self.sample_status = SampleStatus(0)
        """What the host says of the readings in its image; the device adds what it finds itself."""
        stamps = (SAMPLE_COUNTER, SAMPLE_STATUS) if has(od, SAMPLE_COUNTER) else ()
        self._stamps = [self.layout.entries[key_of(*index_of(od, name))].offset for name in stamps]
        """Where the process image has the stamp of a sample: its SYNC counter and status."""
        has_lss = od.device_information.LSS_supported
        self._lss = LssSlave(context, self._storage, self._reset) if has_lss else None
        self._tpdo.on_change = self._triggers.configure
        self._tpdo.on_sent = self._triggers.sent
        services = (self._sync, self._sdo, self._rpdo, self._guarding, self._consumer, self._lss)
        self._listeners = tuple(service for service in services if service is not None)
        self._timed = (
            *(self._guard, self._sync, self._sdo, self._heartbeat, self._consumer),
            *(self._guarding, self._rpdo, self._tpdo, self._emcy),
        )
        self._handlers: Handlers = {}
        self._booted = False
        if self._lss is not None:
            self._lss.power_on()
        for entry in self.layout.entries.values():
            if entry.relative:  # LSS may have stored another node-ID
                self.values.store(entry, self.values.default(entry, context.node_id))

    @property
    def node_id(self) -> int:
        """The node-ID in use."""
        return self._context.node_id

    @property
    def nmt_state(self) -> NmtState:
        """The NMT state."""
        return self._context.state

    @property
    def dropped(self) -> int:
        """Frames that broke a rule since the start."""
        return self._context.dropped

    @property
    def on_write(self) -> WriteHook:
        """Called with (index, sub, value) before a write from the bus is stored."""
        return self._context.dictionary.on_write

    @on_write.setter
    def on_write(self, hook: WriteHook) -> None:
        self._context.dictionary.on_write = hook

    @property
    def runs_freely(self) -> bool:
        """Whether it sends readings on a change or by a timer now, not in answer to a SYNC."""
        return self._tpdo.runs_freely

    @property
    def guards(self) -> bool:
        """Whether it compares its readings with limits now; it is to be told of each sample."""
        return self._guard.is_active

    def get(self, index: int, sub: int = 0) -> Any:
        """A value of the dictionary; KeyError when there is no such entry."""
        return self.values.get(index, sub)

    def set(self, index: int, sub: int, value: Any) -> None:
        """Set a value as the device's own program does: no access rights or limits; services are notified."""
        self.values.put(index, sub, value)
        self._context.dictionary.changed(index, sub)

    def image_view(self, index: int, sub: int, n: int) -> npt.NDArray[Any]:
        """A live view of ``n`` entries from ``sub`` on; see ``Values.view``."""
        return self.values.view(index, sub, n)

    def view_of(self, name: str, n: int) -> npt.NDArray[Any]:
        """A live view of ``n`` elements of an object by its name, from the one that the name says on."""
        index, sub = index_of(self.layout.od, name)
        return self.values.view(index, sub or 1, n)

    def rows_of(self, name: str, n: int) -> npt.NDArray[Any]:
        """A live view of ``n`` records alike, from the one of this name on; see ``Values.rows``."""
        return self.values.rows(index_of(self.layout.od, name)[0], n)

    def emcy(self, code: int, data: bytes = b"") -> bool:
        """An error came: register, history and message follow with the next step; False if it was there."""
        return self._emcy.raise_error(code, data)

    def emcy_clear(self, code: int, data: bytes | None = None) -> bool:
        """An error went (``data`` None: all with this code); False if it was not there."""
        return self._emcy.clear_error(code, data)

    def not_sent(self, now_ns: int, frames: Frames) -> None:
        """Take frames of ours that did not go out: EMCY messages are sent again, others are outdated."""
        self._emcy.not_sent(now_ns, frames)

    def stop_readings(self, is_stopped: bool) -> None:
        """Have the readings in the image mean nothing, or something again.

        They are sent no more, unless a TPDO maps the status of their sample, which is then OLD.
        """
        self.sample_status = SampleStatus.OLD if is_stopped else SampleStatus(0)
        self._tpdo.withhold(is_stopped)

    def sampled(self, age_ns: int) -> None:
        """Have the guard compare the readings in the image, of that age, if they are a new sample."""
        self._guard.sampled(age_ns)

    def transmit_tpdo(self, number: int) -> None:
        """Ask for an event-driven TPDO, if it is sent on events in this state."""
        self._tpdo.request(number)

    def command(self, command: NmtCommand) -> None:
        """Execute an NMT command of the own host; what it sends leaves with the next step.

        Raises:
            LocalProtocolError: before the first step, or without a node-ID.
        """
        if self._context.state is NmtState.INITIALISING:
            raise LocalProtocolError(f"{command.name} for a device that has not booted")
        self._obey(command)

    def skip_sync(self) -> None:
        """Leave out the next SYNC that this device would produce."""
        self._sync.skip()

    def communication_error(self) -> None:
        """Do what 0x1029 says after bus-off or a lost heartbeat (CiA 301, 7.5.2.28)."""
        choice = self.values.number(ERROR_BEHAVIOR, ERROR_BEHAVIOR_COMMUNICATION)
        state = ON_COMMUNICATION_ERROR.get(choice)
        if state is not None and self._context.state is NmtState.OPERATIONAL:
            self._enter(state)

    def step(self, now_ns: int, frames: Frames = ()) -> Step:
        """Take the frames received up to ``now_ns``, do what is due, and say when to call again."""
        context = self._context
        context.now_ns = now_ns
        if not self._booted:
            self._boot()
        for frame in frames:
            if frame[3] == RTR and (frame[0] | REMOTE_ID) in self._handlers:
                self._handlers[frame[0] | REMOTE_ID](frame)
                continue
            handler = self._handlers.get(frame[0])
            if handler is not None:
                if frame[3]:
                    context.drop(frame, "not a classic data frame")
                else:
                    handler(frame)
        if self._program.is_restarting:
            self._restart()
        if self._triggers.active:
            self._triggers.poll()
        wake_ns = self._next_ns()
        if now_ns >= wake_ns:
            for service in self._timed:
                service.tick()
            wake_ns = self._next_ns()
        out, context.out = context.out, []
        events, context.events = context.events, []
        return Step(out, events, wake_ns)

    def _next_ns(self) -> int:
        return min([service.wake_ns for service in self._timed])

    def _receive_nmt(self, frame: Frame) -> None:
        command = command_for(frame.data, self._context.node_id)
        if command is not None:
            self._obey(command)

    def _obey(self, command: NmtCommand) -> None:
        target = TRANSITIONS[command]
        if command is NmtCommand.RESET_NODE:
            self._restart()
        elif target is NmtState.INITIALISING:
            self._reset(application=False)
        elif target is not self._context.state:
            self._enter(target)

    def _restart(self) -> None:
        self._program.start()
        self._reset()

    def _reset(self, *, application: bool = True) -> None:
        """Back to the values of power-on, and boot."""
        self._enter(NmtState.INITIALISING)
        if self._lss is not None:
            self._lss.reset()
        for entry in self.layout.entries.values():  # what is not written over the bus is the device's own
            communication = entry.index < FIRST_APPLICATION_OBJECT
            ours = entry.writable or (communication and entry.relative)
            if ours and (communication or application):
                self.values.store(entry, self.values.default(entry, self.node_id))
        self._boot(application=application)

    def _boot(self, *, application: bool = True) -> None:
        """INITIALISING with the stored values, boot-up message, PRE-OPERATIONAL."""
        context = self._context
        if not self._booted:
            self._booted = True
            self._enter(NmtState.INITIALISING)
        groups = AREAS if application else (COMMUNICATION,)
        loaded = [self._storage.load(group) for group in groups]
        self._verify.loaded(application=application)
        self._program.show()
        for part in (self._sdo, self._emcy, self._heartbeat, self._guarding, self._guard):
            part.reset()
        for service in (self._sync, self._tpdo, self._rpdo, self._consumer):
            service.configure()
        self._listen()
        if context.node_id == UNCONFIGURED:
            return
        if not all(loaded):
            self._emcy.raise_error(EmcyCode.SOFTWARE_DATA_SET)
        self._heartbeat.boot_up()
        self._enter(NmtState.PRE_OPERATIONAL)

    def _enter(self, state: NmtState) -> None:
        self._context.state = state
        for service in (self._sync, self._rpdo, self._tpdo, self._triggers, self._program):
            service.enter(state)
        self._guard.enter()
        if Service.SDO not in SERVICES[state]:
            self._sdo.reset()
        self._emcy.tick()
        self._listen()
        self._context.report(EventKind.NMT_STATE, state.name)
        self.on_nmt(state)

    def _listen(self) -> None:
        """Compile which service receives which identifier in this state; of two for one, the first."""
        state = self._context.state
        handlers: Handlers = {}
        if Service.NMT in SERVICES[state]:
            handlers[NMT_COMMAND_ID] = self._receive_nmt
        for service in self._listeners:
            if service.kind in SERVICES[state]:
                for can_id, handler in service.handlers().items():
                    handlers.setdefault(can_id, handler)
        self._handlers = handlers
        cob_ids = frozenset(handlers)
        if cob_ids != self.cob_ids:  # a new object means a new set
            self.cob_ids = cob_ids

    def _synchronise(self, counter: int) -> None:
        self._rpdo.on_sync()
        self.on_sync(self._context.now_ns, counter)
        if self._stamps:
            status, (at_counter, at_status) = self.sample_status, self._stamps
            if self.values.number(ERROR_REGISTER, 0):
                status |= SampleStatus.ERROR
            # a sample that is older is of no SYNC
            self.values.memory[at_counter] = 0 if status & SampleStatus.OLD else counter
            self.values.memory[at_status] = status
        self._tpdo.on_sync(counter, in_window=self._sync.in_window())
