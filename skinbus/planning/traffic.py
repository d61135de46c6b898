"""Every message on the bus of an arm: from its object dictionaries, with periods and the longest frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from canopen.objectdictionary import ObjectDictionary

from skinbus.can import fd as canfd
from skinbus.can.classic import worst_case_bits
from skinbus.can.fd import CLASSIC_BYTES
from skinbus.objects import cia
from skinbus.objects.pdo import carries_readings, tpdos
from skinbus.objects.profile import number_at
from skinbus.objects.published import master_od
from skinbus.planning.schedule import SECOND, Message, Release

SDO_PATIENCE_NS = 100_000_000
"""An SDO frame may take this long: a third of a common time-out, the canopen package's 0.3 s."""


CONTACTS = 16
"""Contacts published in one cycle: all that the master has objects for."""
SDO_HZ = 100
"""SDO requests, each with its response: a tool that reads records as fast as people can read them."""
BIT_ERROR_RATE = 2.6e-7
"""Share of bits that are hit: measured on CAN two metres from a welding machine; 3e-9 in a factory, 3e-11
in a laboratory. Source: Ferreira et al., An experiment to assess bit error rate in CAN, 2004."""
ERROR_BURST = 1
"""Errors that may come together at any time, beyond that rate."""
ASSUMED = (
    f"{CONTACTS} contacts, 1 EMCY and {SDO_HZ} SDO requests a second, heartbeats by the EDS files, "
    f"bit error rate {BIT_ERROR_RATE:g}, {ERROR_BURST} more to repeat at any time"
)
"""What happens beside the cycle, at most; the analysis holds as long as this does."""


class Traffic(NamedTuple):
    """The messages, and the readings that nothing paces."""

    messages: tuple[Message, ...]
    unpaced: tuple[str, ...]
    """Event-driven TPDOs without inhibit time: once a cycle is only assumed."""


def traffic(
    ods: Sequence[ObjectDictionary],
    *,
    rate_hz: float,
    data_bitrate: int | None = None,
    contacts: int = CONTACTS,
) -> Traffic:
    """Return the traffic of patches with these dictionaries (their node-IDs resolved) and of their master.

    ``data_bitrate`` is that of the data phase of CAN FD, for PDOs of more than 8 bytes.
    """
    period, master = round(SECOND / rate_hz), master_od()
    first = min(map(node_id_of, ods))

    messages = [
        _message("NMT", cia.NMT_COMMAND_ID, 2, SECOND),
        _message("SYNC", cia.SYNC_ID, 1, period, release=Release.SYNC),
        _message("EMCY 1", cia.EMCY_BASE + first, 8, SECOND),
    ]
    for name, base in (("SDO response", cia.SDO_SERVER_BASE), ("SDO request", cia.SDO_CLIENT_BASE)):
        messages.append(_message(name, base + first, 8, SECOND // SDO_HZ, deadline_ns=SDO_PATIENCE_NS))
    for od in [*ods, master]:
        if heartbeat_ms := number_at(od, cia.HEARTBEAT_PRODUCER):
            node_id = node_id_of(od)
            messages.append(
                _message(f"heartbeat {node_id}", cia.HEARTBEAT_BASE + node_id, 1, heartbeat_ms * 1_000_000)
            )

    unpaced: list[str] = []
    for od in ods:
        for pdo in filter(lambda pdo: pdo.valid, tpdos(od)):
            name, every = f"patch {node_id_of(od)} TPDO {pdo.number}", period
            # Of type n > 1 not all come in every cycle; the worst cycle is the one where all do.
            is_cyclic = pdo.transmission_type <= cia.TransmissionType.SYNC_MAX
            if not carries_readings(pdo):  # the state of a guard: it changes when the robot stops anyway
                is_cyclic, every = False, pdo.event_timer_ms * 1_000_000 or period
            elif not is_cyclic:
                every = pdo.inhibit_100us * 100_000 or period
                unpaced += [] if pdo.inhibit_100us else [name]
            release = Release.READING if is_cyclic else Release.SPORADIC
            messages.append(_message(name, pdo.cob_id, pdo.length, every, data_bitrate, release=release))
    published = [pdo for pdo in tpdos(master) if pdo.valid][: 1 + contacts]
    for k, pdo in enumerate(published):
        name = f"contact {k}" if k else "summary"
        messages.append(_message(name, pdo.cob_id, pdo.length, period, release=Release.PUBLISHED))
    messages.sort(key=lambda m: m.cob_id)
    return Traffic(tuple(messages), tuple(unpaced))


def _message(
    name: str, cob_id: int, length: int, period_ns: int, data_bitrate: int | None = None, **more: Any
) -> Message:
    """Return a message of so many bytes."""
    bits: dict[str, Any] = {"bits": worst_case_bits(min(length, CLASSIC_BYTES))}
    if length > CLASSIC_BYTES:
        if data_bitrate is None:
            raise ValueError(f"{name} has {length} bytes, and the bus is not CAN FD")
        long = canfd.worst_case_bits(length)
        bits = {"bits": long.nominal, "data_bits": long.data, "data_bitrate": data_bitrate}
    return Message(name=name, cob_id=cob_id, period_ns=period_ns, **bits, **more)


def node_id_of(od: ObjectDictionary) -> int:
    """Return the node-ID of a dictionary that is resolved for one."""
    assert od.node_id is not None  # load_eds resolves it
    return int(od.node_id)
