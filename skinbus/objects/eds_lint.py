"""Lint of EDS and DCF files: everything that reading does not check and ``dcfchk`` lets pass.

Faults read ``[section] key: is <seen>; wanted <wanted>``, all of a file at once.
Source: CiA 306-1, 4.6; CiA 301, 7.4.3 (sub-index 0), 7.5.2.33 to 7.5.2.38 (PDO parameters),
table 40 (restricted identifiers).
"""

from __future__ import annotations

import re
from dataclasses import replace
from difflib import get_close_matches
from itertools import combinations
from typing import Final, NamedTuple

from skinbus.can.fd import CLASSIC_BYTES, LENGTHS
from skinbus.errors import FaultList
from skinbus.objects import cia
from skinbus.objects.eds_file import LISTS, MAX_SECTIONS, EdsFile, Entry, Variable
from skinbus.objects.eds_values import TYPES, UNSIGNED8, UNSIGNED16, UNSIGNED32, VISIBLE_STRING, parse_integer
from skinbus.objects.pdo import MAX_DUMMY, Direction, split_mapping
from skinbus.objects.profile import FRAME_BYTES

MANDATORY_OBJECTS: Final = (cia.DEVICE_TYPE, cia.ERROR_REGISTER, cia.IDENTITY)
MAX_STRANGE: Final = 1000
"""Unknown keys that are compared with the known ones, which takes 0.1 ms each."""
MAX_ENTRIES: Final = 64
"""Objects mapped to one PDO."""

_KEYS: Final = (
    *("SubNumber", "ParameterName", "ObjectType", "DataType", "AccessType", "LowLimit", "HighLimit"),
    *("DefaultValue", "PDOMapping", "ObjFlags", "CompactSubObj", "ParameterValue", "UploadFile"),
    *("DownloadFile", "Denotation", "ParamRefd", "Unit", "Factor", "Description", "StorageLocation"),
)
_OBJECT = re.compile(r"[0-9a-f]{4}(sub[0-9a-f]{1,2})?")
_OBJECT_LIKE = re.compile(r"[0-9a-f]{4}(sub[0-9a-f]{1,2}|name|value|denotation|objectlinks)?")

_VARIABLES: Final = {
    UNSIGNED8: (cia.ERROR_REGISTER, cia.LIFE_TIME_FACTOR, cia.SYNC_COUNTER_OVERFLOW),
    UNSIGNED16: (cia.GUARD_TIME, cia.EMCY_INHIBIT, cia.HEARTBEAT_PRODUCER),
    UNSIGNED32: (
        *(cia.DEVICE_TYPE, cia.SYNC_COB_ID, cia.SYNC_PERIOD, cia.SYNC_WINDOW),
        cia.EMCY_COB_ID,
    ),
    VISIBLE_STRING: (cia.DEVICE_NAME, cia.HARDWARE_VERSION, cia.SOFTWARE_VERSION),
}
"""Objects whose data type CiA 301 fixes."""
_GROUPS: Final = {
    UNSIGNED8: (cia.ERROR_BEHAVIOR,),
    UNSIGNED32: (
        *(cia.ERROR_HISTORY, cia.STORE_PARAMETERS, cia.RESTORE_DEFAULTS),
        *(cia.HEARTBEAT_CONSUMER, cia.IDENTITY, cia.VERIFY_CONFIGURATION),
    ),
}
"""The same of arrays and records, from sub-index 1 on."""
_PDO_PARAMETERS: Final = {
    cia.PDO_COB_ID: UNSIGNED32,
    cia.PDO_TYPE: UNSIGNED8,
    cia.PDO_INHIBIT: UNSIGNED16,
    cia.PDO_EVENT_TIMER: UNSIGNED16,
    cia.PDO_SYNC_START: UNSIGNED8,
}


class _Identifier(NamedTuple):
    """A COB-ID that the device uses; relative ones are ``base`` + node-ID."""

    variable: Variable
    base: int
    relative: bool

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
    for name in ("FileInfo", "DeviceInfo", "MandatoryObjects"):
        if file.section(name) is None:
            file.fault(name, "", None, "this section")
    for index in MANDATORY_OBJECTS:
        if index not in file.objects:
            file.fault(f"{index:04X}", "", None, "this object: CiA 301 makes it mandatory")
    if cia.IDENTITY in file.objects and file.variable(cia.IDENTITY, cia.IDENTITY_VENDOR) is None:
        file.fault(f"{cia.IDENTITY:04X}sub1", "", None, "the vendor-ID: CiA 301 makes it mandatory")


def _spelling(file: EdsFile) -> None:
    """Names of sections and keys that are nearly those of CiA 306; others are vendors' own."""
    known = {key.lower(): key for key in _KEYS}
    n_strange = 0
    for name, section in file.sections.items():
        if re.match(r"[0-9a-f]{4}", name) and not _OBJECT_LIKE.fullmatch(name):
            file.fault(section.name, "", None, "a section such as [1A00], [1A00sub1] or [1A00Name]")
        for key, text in section.keys.items() if _OBJECT.fullmatch(name) else ():
            if key not in known and n_strange < MAX_STRANGE:
                n_strange += 1
                if near := get_close_matches(key, known, 1, 0.8):
                    file.fault(section.name, section.spelling[key], text, f"the key {known[near[0]]}")


def _lists(file: EdsFile) -> None:
    """Each object stands in one list, the right one, and each list counts its objects."""
    listed: dict[int, str] = {}
    for name in LISTS:
        section = file.section(name)
        if section is None:
            continue
        if len(section.keys) > MAX_SECTIONS:
            file.fault(name, "", None, f"at most {MAX_SECTIONS} objects")
            continue
        numbered = {
            parse_integer(key): text for key, text in section.keys.items() if key != "supportedobjects"
        }
        if parse_integer(section.get("SupportedObjects")) != len(numbered):
            seen = section.get("SupportedObjects") or None
            file.fault(name, "SupportedObjects", seen, f"{len(numbered)}, the number of objects listed")
        for number, text in numbered.items():
            index = parse_integer(text)
            if index is None:
                file.fault(name, str(number), text, "an index such as 0x1018")
                continue
            if index not in file.objects:
                file.fault(name, str(number), text, f"a section [{index:04X}] for it")
            elif index in listed:
                file.fault(name, str(number), text, f"it once; it is in [{listed[index]}] already")
            elif _list_of(index) != name:
                file.fault(name, str(number), text, f"it in [{_list_of(index)}]")
            listed.setdefault(index, name)
    for index, entry in file.objects.items():
        if index >= 0x1000 and index not in listed:  # below are types of the file's own
            file.fault(entry.section, "", None, f"its index in [{_list_of(index)}]")


def _list_of(index: int) -> str:
    if index in MANDATORY_OBJECTS:
        return LISTS[0]
    return LISTS[2] if 0x2000 <= index < 0x6000 else LISTS[1]


def _groups(file: EdsFile) -> None:
    """SubNumber counts the sub-objects; sub-index 0 is an UNSIGNED8 that says the highest of them."""
    for entry in file.objects.values():
        if not entry.is_group or entry.compact:
            continue
        if entry.sub_number != len(entry.variables):
            wanted = f"{len(entry.variables)}, the number of sub-objects"
            file.fault(entry.section, "SubNumber", entry.sub_number, wanted)
        sub0 = entry.variables.get(0)
        if sub0 is None:
            file.fault(f"{entry.section}sub0", "", None, "the number of entries, UNSIGNED8")
        elif sub0.data_type != UNSIGNED8:
            file.fault(sub0.section, "DataType", f"0x{sub0.data_type:04X}", "0x0005, UNSIGNED8")
        else:
            highest, number = max(sub for sub in entry.variables if sub < 0xFF), sub0.number
            counts = entry.index == cia.ERROR_HISTORY or sub0.access not in ("ro", "const")
            if number is not None and number > highest:
                file.fault_at(sub0, number, f"at most {highest}, the highest sub-index")
            elif number != highest and not counts:
                file.fault_at(sub0, number, f"{highest}, the highest sub-index")


def _known_types(file: EdsFile) -> None:
    for data_types, is_group in ((_VARIABLES, False), (_GROUPS, True)):
        for data_type, indices in data_types.items():
            for entry in (file.objects[index] for index in indices if index in file.objects):
                if entry.is_group != is_group:
                    wanted = "0x8 or 0x9, with sub-objects" if is_group else "0x7, VAR"
                    file.fault(entry.section, "ObjectType", f"0x{entry.object_type:X}", wanted)
                    continue
                for sub, variable in entry.variables.items():
                    if (0 < sub < 0xFF or not is_group) and not (variable.generated and sub > 1):
                        _data_type(file, variable, data_type)


def _data_type(file: EdsFile, variable: Variable, wanted: int) -> None:
    if variable.data_type != wanted:
        seen = f"0x{variable.data_type:04X}"
        file.fault(variable.section, "DataType", seen, f"0x{wanted:04X}, {TYPES[wanted].name}")


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


def _names(file: EdsFile) -> None:
    """A manufacturer's objects are distinguished by name."""
    seen: dict[str, str] = {}
    for entry in file.objects.values():
        if 0x2000 <= entry.index < 0x6000 and seen.setdefault(entry.name, entry.section) != entry.section:
            wanted = f"a name of its own; [{seen[entry.name]}] has it"
            file.fault(entry.section, "ParameterName", entry.name, wanted)


def _device_info(file: EdsFile) -> None:
    section = file.section("DeviceInfo")
    if section is None:
        return
    if not any(parse_integer(text) for key, text in section.keys.items() if key.startswith("baudrate_")):
        wanted = "1 for at least one of 10, 20, 50, 125, 250, 500, 800, 1000"
        file.fault(section.name, "BaudRate_*", None, wanted)
    for key, sub in (
        ("VendorNumber", cia.IDENTITY_VENDOR),
        ("ProductNumber", cia.IDENTITY_PRODUCT),
        ("RevisionNumber", cia.IDENTITY_REVISION),
    ):
        variable = file.variable(cia.IDENTITY, sub)
        number, identity = file.integer(section.name, key), variable.number if variable else None
        if number and identity and number != identity:
            file.fault(section.name, key, section.get(key), f"0x{identity:X}, as in [1018sub{sub}]")
    for key, direction in (("NrOfRXPDO", Direction.RPDO), ("NrOfTXPDO", Direction.TPDO)):
        wanted = f"{len(_communication(file, direction))}, the PDOs from [{direction.communication:04X}] on"
        if parse_integer(section.get(key) or "0") != len(_communication(file, direction)):
            file.fault(section.name, key, section.get(key) or None, wanted)


def _communication(file: EdsFile, direction: Direction) -> list[Entry]:
    first = direction.communication
    return [entry for i, entry in sorted(file.objects.items()) if first <= i < first + cia.MAX_PDOS]


def _pdos(file: EdsFile) -> None:
    for direction in Direction:
        between = direction.mapping - direction.communication
        for entry in _communication(file, direction):
            _communication_parameters(file, direction, entry)
            if entry.index + between not in file.objects:
                wanted = f"a mapping parameter [{entry.index + between:04X}] beside it"
                file.fault(entry.section, "", None, wanted)
        for index in range(direction.mapping, direction.mapping + cia.MAX_PDOS):
            if index in file.objects:
                mapping = file.objects[index]
                if index - between not in file.objects:
                    wanted = f"a communication parameter [{index - between:04X}] beside it"
                    file.fault(mapping.section, "", None, wanted)
                _mapping(file, direction, mapping)


def _communication_parameters(file: EdsFile, direction: Direction, entry: Entry) -> None:
    for sub in (cia.PDO_COB_ID, cia.PDO_TYPE):
        if sub not in entry.variables:
            file.fault(f"{entry.section}sub{sub}", "", None, "this sub-object: every PDO has it")
    for sub, variable in entry.variables.items():
        _data_type(file, variable, _PDO_PARAMETERS.get(sub, variable.data_type))
    kind = entry.variables.get(cia.PDO_TYPE)
    last = "254 or 255" if direction is Direction.RPDO else "252 to 255"
    if kind and kind.number in range(241, int(last[:3])):
        file.fault_at(kind, kind.number, f"0 to 240, or {last}; the rest is reserved")


def _mapping(file: EdsFile, direction: Direction, mapping: Entry) -> None:
    count = mapping.variables.get(0)
    if count is None or count.number is None:
        return  # a fault of its own already
    if count.number > MAX_ENTRIES:
        file.fault_at(count, count.number, f"at most {MAX_ENTRIES} mapped objects")
        return
    total = 0
    for sub in range(1, count.number + 1):
        variable = mapping.variables.get(sub)
        if variable is None:
            continue  # sub-index 0 is too large: a fault of its own already
        if variable.data_type != UNSIGNED32 or variable.number is None:
            file.fault_at(variable, variable.number, "an UNSIGNED32: index, sub-index and bits")
            continue
        total += variable.number & 0xFF
        if wanted := _mapped_object(file, direction, variable.number):
            for each in wanted:
                file.fault_at(variable, f"0x{variable.number:08X}", each)
    frame = _frame_bytes(file)
    most = 8 * (CLASSIC_BYTES if frame is None or frame.number is None else frame.number)
    if total > most:
        file.fault(mapping.section, "", f"{total} bits mapped in all", f"at most {most}")


def _frame_bytes(file: EdsFile) -> Variable | None:
    """Return the object of a board for CAN FD that holds the most bytes of a frame; others have none."""
    entries = (entry for entry in file.objects.values() if entry.name == FRAME_BYTES.object)
    members = (v for entry in entries for v in entry.variables.values() if v.name == FRAME_BYTES.member)
    return next(members, None)


def _frame_lengths(file: EdsFile) -> None:
    variable = _frame_bytes(file)
    if variable is not None and variable.number not in LENGTHS[CLASSIC_BYTES:]:
        known = ", ".join(map(str, LENGTHS[CLASSIC_BYTES:]))
        file.fault_at(variable, variable.number, f"a length of a frame: {known}")


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
        e.variables.get(cia.PDO_COB_ID) for direction in Direction for e in _communication(file, direction)
    ]
    others = ((cia.SYNC_COB_ID, 0), (cia.EMCY_COB_ID, 0), (cia.SDO_SERVER, 1), (cia.SDO_SERVER, 2))
    found = [i for v in [*pdos, *(file.variable(*place) for place in others)] if (i := _identifier(v))]
    for identifier in found:
        first, last = identifier.base + identifier.relative, identifier.base + 127 * identifier.relative
        for restricted in cia.RESTRICTED_IDS if identifier.variable in pdos else ():
            if first < restricted.stop and last >= restricted.start:
                ends = f"0x{restricted.start:03X}-0x{restricted.stop - 1:03X}"
                file.fault_at(identifier.variable, str(identifier), f"an identifier outside {ends}")
    for one, other in combinations(found, 2):
        node_id = _clash(one, other)
        if node_id is not None:
            place = f" on node {node_id}" if node_id else ""
            file.fault_at(other.variable, str(other), f"another: [{one.variable.section}] has {one}{place}")


def _identifier(variable: Variable | None) -> _Identifier | None:
    """Return the identifier of an object in use; None if it is switched off or has 29 bits."""
    if variable is None or variable.number is None or variable.current is None:
        return None
    sync = variable.index == cia.SYNC_COB_ID  # bit 31 has no meaning there
    if variable.number & (cia.COB_ID_EXTENDED | (0 if sync else cia.COB_ID_INVALID)):
        return None
    return _Identifier(variable, variable.number & cia.COB_ID_MASK_11, variable.current.relative)


def _clash(first: _Identifier, second: _Identifier) -> int | None:
    """Return the node-ID on which two identifiers are one, 0 if on all; None if on none."""
    if first.relative == second.relative:
        return 0 if first.base == second.base else None
    relative, absolute = (first, second) if first.relative else (second, first)
    node_id = absolute.base - relative.base
    return node_id if 1 <= node_id <= cia.MAX_NODE_ID else None


_RULES: Final = (
    *(_mandatory, _spelling, _lists, _groups, _known_types, _limits, _names, _device_info),
    *(_frame_lengths, _pdos, _identifiers),
)
