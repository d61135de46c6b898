"""The DBC of each bus of an arm: the TPDOs of its patches and of its master, with scales, units and links."""

from __future__ import annotations

import re
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import cantools
from canopen.objectdictionary import ObjectDictionary
from cantools.database.can import Database, Message, Node, Signal
from cantools.database.conversion import BaseConversion

from skinbus.can.fd import CLASSIC_BYTES
from skinbus.config.system import ods_of
from skinbus.model import Arm
from skinbus.objects import cia
from skinbus.objects.contacts import ContactState
from skinbus.objects.eds_values import REAL32, REAL64
from skinbus.objects.pdo import PdoMap, tpdos
from skinbus.objects.published import master_od

LINK_AND_STATE = "Link and state"
"""An object of two halves of a byte, see ``objects.contacts``."""
UNIT = re.compile(r"(.+?) (\d+(?:\.\d+)?)?(mm2|mm|um|ns|us|ms|Pa|N)")
"""A name of ours that says what it counts in: "Force 0.01N", "Latency 10us", "Compute time us"."""
HEAD = 'VERSION ""\nBA_DEF_ "BusType" STRING ;\nBA_DEF_DEF_ "BusType" "CAN";\nBA_ "BusType" "{}";\n'


class Device(NamedTuple):
    """A node of a DBC."""

    name: str
    od: ObjectDictionary
    readings: Mapping[int, tuple[float, float]] = {}
    """Factor and offset of each tactel, Pa, by sub-index."""
    links: Sequence[str] = ()
    """Names of the links, of a master."""


def dbc_of(arm: Arm, bus: int) -> str:
    """Return the DBC of one bus, the master among its nodes: it publishes on all buses alike."""
    ods, devices = ods_of(arm), []
    for p in range(*arm.patches_on(bus).indices(arm.n_patches)):
        placed, here = arm.patches[p], arm.tactels_of(p)
        factors = placed.patch.transducer.step * arm.tactel_gain[here]
        pairs = zip(factors.tolist(), (-arm.tactel_offset[here] * factors).tolist(), strict=True)
        devices.append(Device(f"patch_{placed.node_id}", ods[p], dict(enumerate(pairs, 1))))
    links = [link.name for link in arm.links]
    devices.append(Device("master", master_od(), links=links))
    return dbc(devices, is_fd=arm.buses[bus].data_bitrate is not None)


def dbc(devices: Sequence[Device], *, is_fd: bool = False) -> str:
    """Return the TPDOs of devices as the text of a DBC file: of patches those that are enabled."""
    messages = [
        Message(
            pdo.cob_id,
            _name(_title(device, pdo)),
            pdo.length,
            list(_signals(device, pdo)),
            comment=f"TPDO {pdo.number}, type {pdo.transmission_type}{'' if pdo.valid else ', off'}",
            senders=[_name(device.name)],
            is_extended_frame=pdo.extended,
            is_fd=pdo.length > CLASSIC_BYTES,
        )
        for device in devices
        for pdo in tpdos(device.od)
        if pdo.entries and (pdo.valid or device.links)
    ]
    head: Any = cantools.database.load_string(HEAD.format("CAN FD" if is_fd else "CAN"), "dbc")
    nodes = [Node(_name(device.name)) for device in devices]
    return Database(messages, nodes, version="", dbc_specifics=head.dbc).as_dbc_string()


def _title(device: Device, pdo: PdoMap) -> str:
    """Return the name of a message: of a master that of the object, if it maps no other; else its number."""
    first, objects = pdo.entries[0], {entry.index for entry in pdo.entries if not entry.is_dummy}
    if len(objects) == 1 and device.links:
        whole = device.od.indices[first.index]
        return f"{device.name}_{whole.name}" + (f"_{whole[first.sub].name}" if first.sub > 1 else "")
    return f"{device.name}_TPDO{pdo.number}"


def _signals(device: Device, pdo: PdoMap) -> Iterator[Signal]:
    """Return the signals of a message; the comment of each is its object."""
    used = set[str]()
    for entry in pdo.entries:
        if entry.is_dummy:
            continue
        variable, start, bits = device.od.get_variable(entry.index, entry.sub), entry.offset, entry.bits
        label = variable.name if variable is not None else "object"
        is_float = variable is not None and variable.data_type in (REAL32, REAL64)
        comment = f"0x{entry.index:04X}:{entry.sub:02X}"
        if label == LINK_AND_STATE and bits == 8:
            links = {k: _ascii(link) for k, link in enumerate(device.links[:16])}
            states = {int(state): state.name.lower() for state in ContactState}
            for name, first, words in (("link", start, links), ("state", start + 4, states)):
                choices = BaseConversion.factory(choices=OrderedDict(words))
                yield Signal(name, first, 4, conversion=choices, comment=comment)
            continue
        factor, offset, unit = 1.0, 0.0, ""
        if entry.index in cia.READINGS and entry.sub in device.readings:
            label, (factor, offset), unit = f"tactel_{entry.sub}", device.readings[entry.sub], "Pa"
        elif match := UNIT.fullmatch(label):
            label, factor, unit = match[1], float(match[2] or 1), match[3]
        label = label if label not in used else f"{label} {comment}"
        used.add(label)
        scale = BaseConversion.factory(factor, offset, None, is_float)
        yield Signal(
            _name(label), start, bits, is_signed=entry.signed, conversion=scale, unit=unit, comment=comment
        )


def _ascii(text: str) -> str:
    """Return text as printable ASCII without the characters that end a string of a DBC."""
    return re.sub(r"[^ -~]", "?", text).replace("\\", "/").replace('"', "'")


def _name(text: str) -> str:
    """Return text as a C identifier; cantools shortens long ones."""
    name = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_") or "x"
    return f"_{name}" if name[0].isdigit() else name
