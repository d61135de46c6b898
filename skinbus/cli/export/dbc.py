"""The DBC of each bus of an arm: PDOs of its patches and of its master, with links, scales and places."""

from __future__ import annotations

import re
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import cantools
from canopen.objectdictionary import ObjectDictionary
from cantools.database.can import Database, Message, Node, Signal
from cantools.database.conversion import BaseConversion

from skinbus.can.fd import CLASSIC_BYTES
from skinbus.config.system import ods_of
from skinbus.model import Arm
from skinbus.objects import cia
from skinbus.objects.contacts import ContactState
from skinbus.objects.eds import load_eds
from skinbus.objects.eds_values import REAL32, REAL64
from skinbus.objects.pdo import Direction, PdoEntry, PdoMap, rpdos, tpdos

MASTER: Final = "master"
LONGEST_NAME: Final = 32
"""Characters of a name in a DBC."""
LINK_AND_STATE: Final = "Link and state"
"""An object of two halves of a byte, see ``objects.contacts``."""
UNIT: Final = re.compile(r"(.+?) (\d+(?:\.\d+)?)?(mm2|mm|um|ns|us|ms|Pa|N)")
"""A name of ours that says what it counts in: "Force 0.01N", "Latency 10us", "Compute time us"."""
HEAD: Final = 'VERSION ""\nBA_DEF_ "BusType" STRING ;\nBA_DEF_DEF_ "BusType" "CAN";\nBA_ "BusType" "{}";\n'


class Device(NamedTuple):
    """A node of a DBC, with the factor and offset of its readings by sub-index."""

    name: str
    comment: str
    od: ObjectDictionary
    readings: Mapping[int, tuple[float, float]] = {}
    links: Sequence[str] = ()
    """Names of the links, of a master."""
    cycle_ms: int | None = None
    """Time between two synchronous TPDOs."""


def dbc_of(arm: Arm, bus: int, node_id: int) -> str:
    """Return the DBC of one bus; ``node_id`` is that of the master, which publishes on all buses alike."""
    settings, ods, devices = arm.buses[bus], ods_of(arm), []
    for p in range(*arm.patches_on(bus).indices(arm.n_patches)):
        placed, here = arm.patches[p], arm.tactels_of(p)
        factors = (placed.patch.transducer.step * arm.tactel_gain[here]).tolist()
        pairs = zip(factors, arm.tactel_offset[here].tolist(), strict=True)
        readings = {k: (factor, -offset * factor) for k, (factor, offset) in enumerate(pairs, 1)}
        link = arm.links[placed.link].name
        comment = f"node {placed.node_id} on link {link} at s {1e3 * placed.s:g} mm, a {1e3 * placed.a:g} mm"
        cycle_ms = round(1e3 / settings.rate_hz)
        devices.append(Device(f"patch_{placed.node_id}", comment, ods[p], readings, (), cycle_ms))
    links = [link.name for link in arm.links]
    about = f"node {node_id}: contacts and loads of {arm.name}"
    devices.append(Device(MASTER, about, load_eds("skin-master", node_id), links=links))
    return dbc(devices, is_fd=settings.data_bitrate is not None)


def dbc(devices: Sequence[Device], *, is_fd: bool = False) -> str:
    """Return the PDOs of the devices on one bus as the text of a DBC file."""
    messages, used = [], set[str]()
    for device in devices:
        for direction, pdo in _pdos(device):
            ends = [device.name, MASTER] if direction is Direction.TPDO else [MASTER, device.name]
            receivers = [ends[1]] if ends[0] != ends[1] else []
            when = pdo.transmission_type
            is_cyclic = direction is Direction.TPDO and 1 <= when <= 240
            messages.append(
                Message(
                    pdo.cob_id,
                    _unique(_title(device, direction, pdo), used),
                    pdo.length,
                    list(_signals(device, pdo, receivers)),
                    comment=f"{direction.name} {pdo.number}, type {when}; {_ascii(device.comment)}",
                    senders=[ends[0]],
                    cycle_time=device.cycle_ms * when if is_cyclic and device.cycle_ms else None,
                    is_extended_frame=pdo.extended,
                    is_fd=pdo.length > CLASSIC_BYTES,
                )
            )
    comments = {MASTER: "", **{device.name: _ascii(device.comment) for device in devices}}
    head: Any = cantools.database.load_string(HEAD.format("CAN FD" if is_fd else "CAN"), "dbc")
    nodes = [Node(name, comment) for name, comment in comments.items()]
    return Database(messages, nodes, version="", dbc_specifics=head.dbc).as_dbc_string()


def _pdos(device: Device) -> Iterator[tuple[Direction, PdoMap]]:
    """Yield the PDOs that are enabled and map something."""
    received = rpdos(device.od) if device.name != MASTER else []
    for direction, pdos in ((Direction.TPDO, tpdos(device.od)), (Direction.RPDO, received)):
        yield from ((direction, pdo) for pdo in pdos if pdo.valid and pdo.entries)


def _title(device: Device, direction: Direction, pdo: PdoMap) -> str:
    """Return the name of a message: that of the object if it maps no other, else its number."""
    objects = {entry.index for entry in pdo.entries if not entry.is_dummy}
    if len(objects) == 1 and not device.readings:
        return f"{device.name}_{device.od.indices[objects.pop()].name}"
    return f"{device.name}_{direction.name}{pdo.number}"


def _signals(device: Device, pdo: PdoMap, receivers: list[str]) -> Iterator[Signal]:
    used = set[str]()
    for entry in pdo.entries:
        if entry.is_dummy:
            continue
        for name, start, bits, choices, scale, unit, comment in _parts(device, entry):
            kind = device.od.get_variable(entry.index, entry.sub)
            is_float = kind is not None and kind.data_type in (REAL32, REAL64)
            ends = [raw * scale[0] + scale[1] for raw in _range(bits, signed=entry.signed)]
            yield Signal(
                _unique(name, used),
                start,
                bits,
                is_signed=entry.signed and not choices,
                conversion=BaseConversion.factory(*scale, OrderedDict(choices) or None, is_float),
                minimum=None if is_float else min(ends),
                maximum=None if is_float else max(ends),
                unit=unit,
                comment=comment,
                receivers=receivers,
            )


def _parts(
    device: Device, entry: PdoEntry
) -> list[tuple[str, int, int, dict[int, str], tuple[float, float], str, str]]:
    """Return name, start, bits, choices, scale, unit and comment of the signals of a mapped object."""
    variable = device.od.get_variable(entry.index, entry.sub)
    label = variable.name if variable is not None else f"object {entry.index:04X} {entry.sub}"
    where = f"0x{entry.index:04X}:{entry.sub:02X} {_ascii(label)}"
    place = entry.offset, entry.bits
    if entry.index in cia.READINGS and entry.sub in device.readings:
        where += ": pressure by offset and gain of this tactel, before its zero"
        return [(f"tactel_{entry.sub}", *place, {}, device.readings[entry.sub], "Pa", where)]
    if label == LINK_AND_STATE and entry.bits == 8:
        links = {k: _ascii(link) for k, link in enumerate(device.links[:16])}
        states = {int(state): state.name.lower() for state in ContactState}
        return [
            ("link", entry.offset, 4, links, (1.0, 0.0), "", f"{where}: link"),
            ("state", entry.offset + 4, 4, states, (1.0, 0.0), "", f"{where}: state"),
        ]
    if variable is not None and (variable.unit or variable.factor not in (1, None)):
        return [(label, *place, {}, (float(variable.factor or 1), 0.0), variable.unit or "", where)]
    if match := UNIT.fullmatch(label):
        return [(match[1], *place, {}, (float(match[2] or 1), 0.0), match[3], where)]
    return [(label, *place, {}, (1.0, 0.0), "", where)]


def _range(bits: int, *, signed: bool) -> tuple[int, int]:
    return -(1 << (bits - 1)) if signed else 0, (1 << (bits - signed)) - 1


def _ascii(text: str) -> str:
    """Return text as printable ASCII without the characters that end a string of a DBC."""
    plain = "".join(c if " " <= c <= "~" else "?" for c in text)
    return plain.replace("\\", "/").replace('"', "'")


def _unique(text: str, used: set[str]) -> str:
    """Return text as a C identifier of at most 32 characters that is not in ``used``, and put it there."""
    name = re.sub(r"[^0-9A-Za-z_]+", "_", text).strip("_") or "x"
    name = (f"_{name}" if name[0].isdigit() else name)[:LONGEST_NAME]
    k, own = 2, name
    while own in used:
        own, k = f"{name[: LONGEST_NAME - 4]}_{k}", k + 1
    used.add(own)
    return own
