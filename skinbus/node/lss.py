"""The LSS slave (CiA 305): node-ID and bit timing given over the bus; fastscan finds unconfigured nodes."""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import IntEnum
from operator import eq, ge, le

from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.node.context import Context, Handlers, Part
from skinbus.node.nmt import Service
from skinbus.node.storage import LSS, StorageService
from skinbus.objects.cia import BIT_RATES, IDENTITY, LSS_MASTER_ID, LSS_SLAVE_ID, MAX_NODE_ID

UNCONFIGURED = 0xFF
FRAME_LENGTH = 8
N_IDENTITY = 4


class Mode(IntEnum):
    """States of LSS."""

    WAITING = 0
    CONFIGURATION = 1


class Lss(IntEnum):
    """Command specifiers (CiA 305, 3.9)."""

    SWITCH_GLOBAL = 0x04
    CONFIGURE_NODE_ID = 0x11
    CONFIGURE_BIT_TIMING = 0x13
    ACTIVATE_BIT_TIMING = 0x15
    STORE = 0x17
    SWITCH_VENDOR = 0x40  # to SWITCH_SERIAL: by the numbers of the identity in their order
    SWITCH_SERIAL = 0x43
    SWITCHED = 0x44
    IDENTIFY_VENDOR = 0x46  # to IDENTIFY_SERIAL_HIGH: the same, with two ends of revision and serial
    IDENTIFY_SERIAL_HIGH = 0x4B
    IDENTIFY_UNCONFIGURED = 0x4C
    IDENTIFIED = 0x4F
    UNCONFIGURED_IDENTIFIED = 0x50
    FASTSCAN = 0x51
    INQUIRE_VENDOR = 0x5A  # to INQUIRE_NODE_ID: the same, and the node-ID
    INQUIRE_NODE_ID = 0x5E


OK = 0
STORE_NOT_SUPPORTED = 1
STORE_FAILED = 2

FASTSCAN_ALL = 0x80
"""Bit check that every unconfigured node answers, and with which a scan begins."""

IDENTIFIES = ((0, eq), (1, eq), (2, ge), (2, le), (3, ge), (3, le))
"""Of the commands that identify: which number of the identity is how to the one in the command."""
FASTSCAN = struct.Struct("<IBBB")
"""Data of a fastscan request: number, bit check, which number of the identity, and which follows."""


def _number(data: bytes) -> int:
    return int.from_bytes(data[1:5], "little")


def lss_request(command: int, data: bytes = b"") -> Frame:
    """Return a request of an LSS master."""
    return Frame(LSS_MASTER_ID, (bytes([command]) + data).ljust(FRAME_LENGTH, b"\0"))


class LssSlave(Part):
    """Answers the LSS master; a node-ID takes effect with a reset, at once on an unconfigured node."""

    kind = Service.LSS

    def __init__(self, context: Context, storage: StorageService, on_configured: Callable[[], None]) -> None:
        super().__init__(context)
        self.storage = storage
        self.bit_rates = frozenset(self.dictionary.layout.od.device_information.allowed_baudrates)
        self.on_configured = on_configured
        self.mode = Mode.WAITING
        self.pending_node_id = context.node_id
        self.pending_bit_rate: int | None = None
        self._next = self._scanned = 0
        both = {
            **dict.fromkeys(range(Lss.IDENTIFY_VENDOR, Lss.IDENTIFY_SERIAL_HIGH + 1), self._identify),
            Lss.IDENTIFY_UNCONFIGURED: self._identify_unconfigured,
            Lss.SWITCH_GLOBAL: self._switch_global,
        }
        self._table: dict[Mode, dict[int, Callable[[bytes], None]]] = {
            Mode.WAITING: {
                **both,
                **dict.fromkeys(range(Lss.SWITCH_VENDOR, Lss.SWITCH_SERIAL + 1), self._switch_selective),
                Lss.FASTSCAN: self._fastscan,
            },
            Mode.CONFIGURATION: {
                **both,
                Lss.CONFIGURE_NODE_ID: self._configure_node_id,
                Lss.CONFIGURE_BIT_TIMING: self._configure_bit_timing,
                Lss.ACTIVATE_BIT_TIMING: self._activate_bit_timing,
                Lss.STORE: self._store,
                **dict.fromkeys(range(Lss.INQUIRE_VENDOR, Lss.INQUIRE_NODE_ID + 1), self._inquire),
            },
        }

    def power_on(self) -> None:
        """Take the node-ID that was stored, if one was."""
        lines = self.storage.kept(LSS)
        if not lines:
            return
        try:
            node_id, bit_rate = (int(word) for word in lines[0].split())
        except ValueError:
            self.context.report(EventKind.STORAGE, f"{LSS}: {lines[0]!r}; wanted node-ID and bit rate")
            return
        if 1 <= node_id <= MAX_NODE_ID or node_id == UNCONFIGURED:
            self.context.node_id = self.pending_node_id = node_id
            self.pending_bit_rate = bit_rate or None

    def reset(self) -> None:
        """The node-ID that was configured becomes the one in use."""
        self.mode = Mode.WAITING
        self._next = 0
        self.context.node_id = self.pending_node_id

    def handlers(self) -> Handlers:
        """The identifier of the LSS master."""
        return {LSS_MASTER_ID: self.receive}

    def receive(self, frame: Frame) -> None:
        """One request; those of another mode are not answered."""
        if len(frame.data) != FRAME_LENGTH:
            self.context.drop(frame, "LSS has 8 bytes")
            return
        action = self._table[self.mode].get(frame.data[0])
        if action is not None:
            action(frame.data)

    @property
    def _unconfigured(self) -> bool:
        return self.context.node_id == UNCONFIGURED and self.pending_node_id == UNCONFIGURED

    @property
    def _identity(self) -> list[int]:
        """Vendor, product, revision and serial number."""
        return [self.values.number(IDENTITY, sub) for sub in range(1, 1 + N_IDENTITY)]

    def _answer(self, command: int, data: bytes = b"") -> None:
        self.context.send(LSS_SLAVE_ID, (bytes((command,)) + data).ljust(FRAME_LENGTH, b"\0"))

    def _switch_global(self, data: bytes) -> None:
        if data[1] > Mode.CONFIGURATION:
            return
        self.mode = Mode(data[1])
        self._next = 0
        waiting_with_id = self.mode is Mode.WAITING and self.pending_node_id != UNCONFIGURED
        if waiting_with_id and self.context.node_id == UNCONFIGURED:
            self.on_configured()

    def _switch_selective(self, data: bytes) -> None:
        """Four frames name one node; the last one switches it."""
        own = self._identity[data[0] - Lss.SWITCH_VENDOR]
        if self._names(data[0], Lss.SWITCH_VENDOR, Lss.SWITCH_SERIAL, is_ours=own == _number(data)):
            self.mode = Mode.CONFIGURATION
            self._answer(Lss.SWITCHED)

    def _identify(self, data: bytes) -> None:
        """Six frames name a range; the last one is answered by each node in it."""
        part, compare = IDENTIFIES[data[0] - Lss.IDENTIFY_VENDOR]
        is_ours = compare(self._identity[part], _number(data))
        if self._names(data[0], Lss.IDENTIFY_VENDOR, Lss.IDENTIFY_SERIAL_HIGH, is_ours=is_ours):
            self._answer(Lss.IDENTIFIED)

    def _names(self, command: int, first: int, last: int, *, is_ours: bool) -> bool:
        """Whether this is the last of commands that follow each other, all of which fit this node."""
        goes_on = is_ours and command in (first, self._next)
        self._next = command + 1 if goes_on else 0
        return goes_on and command == last

    def _identify_unconfigured(self, data: bytes) -> None:
        if self._unconfigured:
            self._answer(Lss.UNCONFIGURED_IDENTIFIED)

    def _fastscan(self, data: bytes) -> None:
        """Answer while the bits asked so far are ours; the last bit of the last number switches this node."""
        if not self._unconfigured:
            return
        number, bit, part, following = FASTSCAN.unpack_from(data, 1)
        if bit == FASTSCAN_ALL:
            self._scanned = 0
            self._answer(Lss.IDENTIFIED)
        elif bit < 32 and part < N_IDENTITY and following < N_IDENTITY and part == self._scanned:
            if number >> bit != self._identity[part] >> bit:
                return
            self._scanned = following
            self._answer(Lss.IDENTIFIED)
            if bit == 0 and following < part:
                self.mode = Mode.CONFIGURATION

    def _configure_node_id(self, data: bytes) -> None:
        good = 1 <= data[1] <= MAX_NODE_ID or data[1] == UNCONFIGURED
        if good:
            self.pending_node_id = data[1]
        self._answer(data[0], bytes((not good,)))

    def _configure_bit_timing(self, data: bytes) -> None:
        rate = BIT_RATES.get(data[2]) if data[1] == 0 else None  # of the standard table
        good = rate is not None and rate in self.bit_rates
        if good:
            self.pending_bit_rate = rate
        self._answer(data[0], bytes((not good,)))

    def _activate_bit_timing(self, data: bytes) -> None:
        """The host owns the interface: it waits the delay, switches, and waits the delay again."""
        if self.pending_bit_rate is not None:
            delay_ms = int.from_bytes(data[1:3], "little")
            self.context.report(EventKind.BIT_RATE, f"{self.pending_bit_rate} after {delay_ms} ms")

    def _store(self, data: bytes) -> None:
        error = OK
        try:
            self.storage.keep(LSS, f"{self.pending_node_id} {self.pending_bit_rate or 0}")
        except OSError as fault:
            self.context.report(EventKind.STORAGE, f"{LSS}: {fault}")
            error = STORE_NOT_SUPPORTED if self.storage.storage is None else STORE_FAILED
        self._answer(data[0], bytes((error,)))

    def _inquire(self, data: bytes) -> None:
        number = (*self._identity, self.context.node_id)[data[0] - Lss.INQUIRE_VENDOR]
        self._answer(data[0], number.to_bytes(4, "little"))
