"""Every message on the bus of an arm: from its object dictionaries, with periods and the longest frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

from canopen.objectdictionary import ObjectDictionary

from skinbus.can import fd as canfd
from skinbus.can.classic import worst_case_bits
from skinbus.can.fd import CLASSIC_BYTES
from skinbus.objects import cia
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import PdoMap, tpdos
from skinbus.objects.profile import MASTER_NODE_ID, number_at
from skinbus.planning.schedule import SECOND, ErrorModel, Message, Release

MASTER_EDS: Final = "skin-master"

SDO_PATIENCE_NS: Final = 100_000_000
"""An SDO frame may take this long: a third of a common time-out, the canopen package's 0.3 s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Beside:
    """What happens beside the cycle, at most; the analysis holds as long as this does."""

    contacts: int = 16
    """Contacts published in one cycle: all that the master has objects for."""
    emergencies: int = 1
    """EMCY messages within a second: faults come one at a time."""
    sdo_hz: float = 100.0
    """SDO requests, each with its response: a tool that reads records as fast as people can read them."""
    bit_error_rate: float = 2.6e-7
    """Share of bits that are hit: measured on CAN two metres from a welding machine; 3e-9 in a factory, 3e-11
    in a laboratory. Source: Ferreira et al., An experiment to assess bit error rate in CAN, 2004."""
    error_burst: int = 1
    """Errors that may come together at any time, beyond that rate."""

    def errors(self, bitrate: int) -> ErrorModel:
        """Return the errors on a bus of this bit rate, were it always busy."""
        return ErrorModel(per_s=self.bit_error_rate * bitrate, burst=self.error_burst)

    @property
    def text(self) -> str:
        """What is assumed, in a line."""
        return (
            f"{self.contacts} contacts, {self.emergencies} EMCY and {self.sdo_hz:g} SDO requests a second, "
            f"heartbeats by the EDS files, bit error rate {self.bit_error_rate:g}, "
            f"{self.error_burst} more to repeat at any time"
        )


@dataclass(frozen=True, slots=True)
class Traffic:
    """The messages, and the readings that nothing paces."""

    messages: tuple[Message, ...]
    unpaced: tuple[str, ...]
    """Event-driven TPDOs without inhibit time: once a cycle is only assumed."""


def traffic(
    ods: Sequence[ObjectDictionary],
    *,
    rate_hz: float,
    data_bitrate: int | None = None,
    beside: Beside | None = None,
) -> Traffic:
    """Return the traffic of patches with these dictionaries (their node-IDs resolved) and of their master.

    ``data_bitrate`` is that of the data phase of CAN FD, for PDOs of more than 8 bytes.
    """
    beside = beside or Beside()
    period = round(SECOND / rate_hz)
    master = _master()
    first = min(_node_id(od) for od in ods)

    messages = [
        Message(name="NMT", cob_id=cia.NMT_COMMAND_ID, bits=worst_case_bits(2), period_ns=SECOND),
        Message(
            name="SYNC", cob_id=cia.SYNC_ID, bits=worst_case_bits(1), period_ns=period, release=Release.SYNC
        ),
    ]
    for k in range(beside.emergencies):
        cob_id = cia.EMCY_BASE + first + k
        name = f"EMCY {k + 1}"
        messages.append(Message(name=name, cob_id=cob_id, bits=worst_case_bits(8), period_ns=SECOND))

    unpaced: list[str] = []
    for od in ods:
        for pdo in tpdos(od):
            if pdo.valid:
                messages.append(_reading(pdo, _node_id(od), period, unpaced, data_bitrate))
    published = [pdo for pdo in tpdos(master) if pdo.valid]
    for pdo in published[: 1 + beside.contacts]:
        name = "summary" if pdo is published[0] else f"contact {pdo.number - 1}"
        messages.append(_message(name, pdo, period, Release.PUBLISHED))

    if beside.sdo_hz > 0.0:
        every = round(SECOND / beside.sdo_hz)
        for name, base in (("SDO response", cia.SDO_SERVER_BASE), ("SDO request", cia.SDO_CLIENT_BASE)):
            sdo = Message(
                name=name,
                cob_id=base + first,
                bits=worst_case_bits(8),
                period_ns=every,
                deadline_ns=SDO_PATIENCE_NS,
            )
            messages.append(sdo)
    for od in [*ods, master]:
        node_id = _node_id(od)
        heartbeat_ms = number_at(od, cia.HEARTBEAT_PRODUCER)
        if heartbeat_ms:
            cob_id, every = cia.HEARTBEAT_BASE + node_id, heartbeat_ms * 1_000_000
            messages.append(
                Message(name=f"heartbeat {node_id}", cob_id=cob_id, bits=worst_case_bits(1), period_ns=every)
            )
    messages.sort(key=lambda m: m.cob_id)
    return Traffic(tuple(messages), tuple(unpaced))


def _reading(pdo: PdoMap, node_id: int, period: int, unpaced: list[str], data_bitrate: int | None) -> Message:
    """Return a TPDO as it is released: with the SYNC, or by events no faster than its inhibit time."""
    name = f"patch {node_id} TPDO {pdo.number}"
    if pdo.transmission_type <= cia.TransmissionType.SYNC_MAX:
        # Of type n > 1 not all come in every cycle; the worst cycle is the one where all do.
        return _message(name, pdo, period, Release.READING, data_bitrate)
    every = pdo.inhibit_100us * 100_000
    if not every:
        unpaced.append(name)
    return _message(name, pdo, every or period, Release.SPORADIC, data_bitrate)


def _message(
    name: str, pdo: PdoMap, period: int, release: Release, data_bitrate: int | None = None
) -> Message:
    message = Message(name=name, cob_id=pdo.cob_id, bits=0, period_ns=period, release=release)
    if pdo.length <= CLASSIC_BYTES:
        return replace(message, bits=worst_case_bits(pdo.length))
    if data_bitrate is None:
        raise ValueError(f"{name} has {pdo.length} bytes, and the bus is not CAN FD")
    bits = canfd.worst_case_bits(pdo.length)
    return replace(message, bits=bits.nominal, data_bits=bits.data, data_bitrate=data_bitrate)


@cache
def _master() -> ObjectDictionary:
    """Return the dictionary of the master, which is only read here: a search asks for it many times."""
    return load_eds(MASTER_EDS, MASTER_NODE_ID)


def _node_id(od: ObjectDictionary) -> int:
    assert od.node_id is not None  # load_eds resolves it
    return int(od.node_id)
