"""Lint of EDS and DCF files: what would keep a board from working, and reading does not find.

Lists of objects, [DeviceInfo], numbers of sub-objects and data types of CiA's objects are not looked at:
nothing here depends on them, and dcfchk of dcf-tools says them.

Faults read ``[section] key: is <seen>; wanted <wanted>``, all of a file at once.
Source: CiA 306-1, 4.6; CiA 301, 7.5.2.33 to 7.5.2.38 (PDO parameters), table 40 (restricted identifiers).
"""

from __future__ import annotations

import re
from dataclasses import replace
from difflib import get_close_matches
from typing import NamedTuple

from skinbus.can.fd import CLASSIC_BYTES, MAX_BYTES
from skinbus.errors import FaultList
from skinbus.objects import cia
from skinbus.objects.eds_file import OBJECT, EdsFile, Entry, Variable
from skinbus.objects.eds_values import TYPES, UNSIGNED32
from skinbus.objects.pdo import MAX_DUMMY, Direction, split_mapping
from skinbus.objects.profile import FRAME_BYTES

MANDATORY_OBJECTS = (cia.DEVICE_TYPE, cia.ERROR_REGISTER, cia.IDENTITY)
MAX_STRANGE = 1000
"""Unknown keys that are compared with the known ones, which takes 0.1 ms each."""
MAX_ENTRIES = 64
"""Objects mapped to one PDO."""

_KEYS = (
    *("SubNumber", "ParameterName", "ObjectType", "DataType", "AccessType", "LowLimit", "HighLimit"),
    *("DefaultValue", "PDOMapping", "ObjFlags", "CompactSubObj", "ParameterValue", "UploadFile"),
    *("DownloadFile", "Denotation", "ParamRefd", "Unit", "Factor", "Description", "StorageLocation"),
)
_OBJECT_LIKE = re.compile(r"[0-9a-f]{4}(sub[0-9a-f]{1,2}|name|value|denotation|objectlinks)?")


class _Identifier(NamedTuple):
    """A COB-ID that the device uses; relative ones are ``base`` + node-ID."""

    variable: Variable
    base: int
    relative: bool

    def at(self, node_id: int) -> int:
        return self.base + self.relative * node_id

    def __str__(self) -> str:
        return f"$NODEID+0x{self.base:X}" if self.relative else f"0x{self.base:X}"


def lint(file: EdsFile) -> FaultList:
    """Return every fault of a file, those of its reading first."""
    if not file.sections:  # it is no EDS, and that was said
        return FaultList(file.faults)
    checked = replace(file, faults=FaultList(file.faults))
    for rule in _RULES:
        rule(checked)
    once = FaultList(dict.fromkeys(checked.faults))
    once.n_more += checked.faults.n_more
    return once


def _mandatory(file: EdsFile) -> None:
    for index in MANDATORY_OBJECTS:
        if index not in file.objects:
            file.fault(f"{index:04X}", "", None, "this object: CiA 301 makes it mandatory")


def _spelling(file: EdsFile) -> None:
    """Names of sections and keys that are nearly those of CiA 306; others are vendors' own."""
    known = {key.lower(): key for key in _KEYS}
    n_strange = 0
    for name, section in file.sections.items():
        if re.match(r"[0-9a-f]{4}", name) and not _OBJECT_LIKE.fullmatch(name):
            file.fault(section.name, "", None, "a section such as [1A00], [1A00sub1] or [1A00Name]")
        for key, text in section.keys.items() if OBJECT.fullmatch(name) else ():
            if key not in known and n_strange < MAX_STRANGE:
                n_strange += 1
                if near := get_close_matches(key, known, 1, 0.8):
                    file.fault(section.name, section.spelling[key], text, f"the key {known[near[0]]}")


def _limits(file: EdsFile) -> None:
    for variable in (v for entry in file.objects.values() for v in entry.variables.values()):
        low, high = variable.low, variable.high
        if low is not None and high is not None and low > high:
            file.fault(variable.section, "LowLimit", low, f"at most {high:g}, the high limit")
            continue
        for key, value in (("DefaultValue", variable.default), ("ParameterValue", variable.value)):
            if value is None or value.relative or not isinstance(value.number, int | float):
                continue
            if low is not None and value.number < low:
                file.fault(variable.section, key, value.number, f"at least {low:g}, the low limit")
            if high is not None and value.number > high:
                file.fault(variable.section, key, value.number, f"at most {high:g}, the high limit")


def _pdos(file: EdsFile) -> None:
    for direction in Direction:
        for k in range(cia.MAX_PDOS):
            places = direction.communication + k, direction.mapping + k
            entry, mapping = map(file.objects.get, places)
            if entry:
                _communication_parameters(file, direction, entry)
                if not mapping:
                    file.fault(entry.section, "", None, f"a mapping parameter [{places[1]:04X}] beside it")
            if mapping:
                if not entry:
                    wanted = f"a communication parameter [{places[0]:04X}] beside it"
                    file.fault(mapping.section, "", None, wanted)
                _mapping(file, direction, mapping)


def _communication_parameters(file: EdsFile, direction: Direction, entry: Entry) -> None:
    for sub in (cia.PDO_COB_ID, cia.PDO_TYPE):
        if sub not in entry.variables:
            file.fault(f"{entry.section}sub{sub}", "", None, "this sub-object: every PDO has it")
    kind = entry.variables.get(cia.PDO_TYPE)
    last = "254 or 255" if direction is Direction.RPDO else "252 to 255"
    if kind and kind.number in range(241, int(last[:3])):
        file.fault_at(kind, kind.number, f"0 to 240, or {last}; the rest is reserved")


def _mapping(file: EdsFile, direction: Direction, mapping: Entry) -> None:
    count = mapping.variables.get(0)
    if count is None or count.number is None:
        return  # a fault of its own already
    most = min(max(mapping.variables), MAX_ENTRIES)
    if count.number > most:
        file.fault_at(count, count.number, f"at most {most} mapped objects")
    total = 0
    for sub in range(1, min(count.number, most) + 1):
        variable = mapping.variables.get(sub)
        if variable is None:
            file.fault(f"{mapping.section}sub{sub:X}", "", None, "this sub-object: it is mapped")
            continue
        if variable.data_type != UNSIGNED32 or variable.number is None:
            file.fault_at(variable, variable.number, "an UNSIGNED32: index, sub-index and bits")
            continue
        total += variable.number & 0xFF
        for wanted in _mapped_object(file, direction, variable.number):
            file.fault_at(variable, f"0x{variable.number:08X}", wanted)
    is_fd = any(
        FRAME_BYTES.endswith(f"/{v.name}") for e in file.objects.values() for v in e.variables.values()
    )
    most = 8 * (MAX_BYTES if is_fd else CLASSIC_BYTES)
    if total > most:
        file.fault(mapping.section, "", f"{total} bits mapped in all", f"at most {most}")


def _mapped_object(file: EdsFile, direction: Direction, value: int) -> list[str]:
    """Return what is wanted of an entry of a mapping: an object that is mappable and that long."""
    index, sub, bits = split_mapping(value)
    if value == 0:
        return ["an object, or a smaller number in sub-index 0"]
    if index <= MAX_DUMMY:
        if index not in TYPES or file.integer("DummyUsage", f"Dummy{index:04X}") != 1:
            return [f"Dummy{index:04X}=1 in [DummyUsage], or an object"]
        return [] if bits == TYPES[index].bits else [f"{TYPES[index].bits} bits (0x{TYPES[index].bits:02X})"]
    target = file.variable(index, sub)
    if target is None:
        return [f"an object that exists, not 0x{index:04X}:{sub:02X}"]
    wanted = []
    if not target.mappable:
        wanted.append(f"an object with PDOMapping=1, not [{target.section}]")
    if bits != target.bits:
        wanted.append(f"{target.bits} bits (0x{target.bits:02X}), the length of [{target.section}]")
    is_sent = direction is Direction.TPDO
    if target.access in (("wo", "rww") if is_sent else ("ro", "const", "rwr")):
        wanted.append(f"an object to {'read' if is_sent else 'write'}; [{target.section}] is {target.access}")
    return wanted


def _identifiers(file: EdsFile) -> None:
    """No PDO on a restricted identifier, and no identifier used twice, whatever the node-ID."""
    pdos = [
        file.variable(direction.communication + k, cia.PDO_COB_ID)
        for direction in Direction
        for k in range(cia.MAX_PDOS)
    ]
    others = ((cia.SYNC_COB_ID, 0), (cia.EMCY_COB_ID, 0), (cia.SDO_SERVER, 1), (cia.SDO_SERVER, 2))
    found = [i for v in [*pdos, *(file.variable(*place) for place in others)] if (i := _identifier(v))]
    for identifier in found:
        for restricted in cia.RESTRICTED_IDS if identifier.variable in pdos else ():
            if identifier.at(1) < restricted.stop and identifier.at(127) >= restricted.start:
                ends = f"0x{restricted.start:03X}-0x{restricted.stop - 1:03X}"
                file.fault_at(identifier.variable, str(identifier), f"an identifier outside {ends}")
    clashes: dict[tuple[int, int], int] = {}
    for node_id in range(1, cia.MAX_NODE_ID + 1):
        owners: dict[int, int] = {}
        for k, identifier in enumerate(found):
            owner = owners.setdefault(identifier.at(node_id), k)
            if owner != k:
                clashes.setdefault((owner, k), node_id)
    for (first, second), node_id in clashes.items():
        one, other = found[first], found[second]
        place = "" if one.relative == other.relative else f" on node {node_id}"
        file.fault_at(other.variable, str(other), f"another: [{one.variable.section}] has {one}{place}")


def _identifier(variable: Variable | None) -> _Identifier | None:
    """Return the identifier of an object in use; None if it is switched off or has 29 bits."""
    if variable is None or variable.number is None or variable.current is None:
        return None
    sync = variable.index == cia.SYNC_COB_ID  # bit 31 has no meaning there
    if variable.number & (cia.COB_ID_EXTENDED | (0 if sync else cia.COB_ID_INVALID)):
        return None
    return _Identifier(variable, variable.number & cia.COB_ID_MASK_11, variable.current.relative)


_RULES = (
    _mandatory,
    _spelling,
    _limits,
    _pdos,
    _identifiers,
)
