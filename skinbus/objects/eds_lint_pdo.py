"""Lint of what an EDS says of PDOs: identifiers, types, mappings, their number and their clashes.

Source: CiA 301, 7.5.2.33 to 7.5.2.38 (PDO parameters), table 40 (restricted identifiers).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

from skinbus.can.fd import CLASSIC_BYTES, LENGTHS
from skinbus.objects import cia
from skinbus.objects.eds_file import EdsFile, Entry, Variable
from skinbus.objects.eds_values import (
    TYPES,
    UNSIGNED8,
    UNSIGNED16,
    UNSIGNED32,
    Value,
    parse_integer,
)
from skinbus.objects.pdo import MAX_DUMMY, Direction, split_mapping
from skinbus.objects.profile import FRAME_BYTES

MAX_ENTRIES: Final = 64
"""Objects mapped to one PDO."""

_PARAMETER_TYPES: Final = {
    cia.PDO_COB_ID: UNSIGNED32,
    cia.PDO_TYPE: UNSIGNED8,
    cia.PDO_INHIBIT: UNSIGNED16,
    cia.PDO_EVENT_TIMER: UNSIGNED16,
    cia.PDO_SYNC_START: UNSIGNED8,
}


@dataclass(frozen=True, slots=True)
class _Identifier:
    """A COB-ID that the device uses; relative ones are ``base`` + node-ID."""

    variable: Variable
    base: int
    relative: bool

    def __str__(self) -> str:
        return f"$NODEID+0x{self.base:X}" if self.relative else f"0x{self.base:X}"

    def range(self) -> range:
        return range(self.base + 1, self.base + 128) if self.relative else range(self.base, self.base + 1)


def _pdo_counts(file: EdsFile, fault: Any) -> None:
    section = file.section("DeviceInfo")
    if section is None:
        return
    for key, direction in (("NrOfRXPDO", Direction.RPDO), ("NrOfTXPDO", Direction.TPDO)):
        wanted = len(_communication(file, direction))
        if parse_integer(section.get(key) or "0") != wanted:
            first = direction.communication
            fault(section.name, key, section.get(key) or None, f"{wanted}, the PDOs from [{first:04X}] on")


def _pdos(file: EdsFile, fault: Any) -> None:
    for direction in Direction:
        for entry in _communication(file, direction):
            number = entry.index - direction.communication
            _communication_parameters(direction, entry, fault)
            mapping = file.objects.get(direction.mapping + number)
            if mapping is None:
                wanted = f"a mapping parameter [{direction.mapping + number:04X}] beside it"
                fault(entry.section, "", None, wanted)
        for index in range(direction.mapping, direction.mapping + cia.MAX_PDOS):
            mapping = file.objects.get(index)
            if mapping is None:
                continue
            if index - direction.mapping + direction.communication not in file.objects:
                partner = index - direction.mapping + direction.communication
                fault(mapping.section, "", None, f"a communication parameter [{partner:04X}] beside it")
            _mapping(file, direction, mapping, fault)


def _communication_parameters(direction: Direction, entry: Entry, fault: Any) -> None:
    for sub in (cia.PDO_COB_ID, cia.PDO_TYPE):
        if sub not in entry.variables:
            fault(f"{entry.section}sub{sub}", "", None, "this sub-object: every PDO has it")
    for sub, variable in entry.variables.items():
        wanted = _PARAMETER_TYPES.get(sub)
        if wanted is not None and variable.data_type != wanted:
            seen = f"0x{variable.data_type:04X}"
            fault(variable.section, "DataType", seen, f"0x{wanted:04X}, {TYPES[wanted].name}")
    kind = entry.variables.get(cia.PDO_TYPE)
    number = kind.current.number if kind and kind.current else None
    reserved = list(cia.TransmissionType.RESERVED)
    if direction is Direction.RPDO:
        reserved += [cia.TransmissionType.RTR_SYNC, cia.TransmissionType.RTR_EVENT]
    if kind and number in reserved:
        tail = "254 or 255" if direction is Direction.RPDO else "252 to 255"
        fault(kind.section, _key(kind), number, f"0 to 240, or {tail}; the rest is reserved")


def _mapping(file: EdsFile, direction: Direction, mapping: Entry, fault: Any) -> None:
    count = mapping.variables.get(0)
    n = count.current.number if count and count.current else 0
    if count is None or not isinstance(n, int):
        return  # a fault of its own already
    if n > MAX_ENTRIES:
        fault(count.section, _key(count), n, f"at most {MAX_ENTRIES} mapped objects")
        return
    total = 0
    for sub in range(1, n + 1):
        variable = mapping.variables.get(sub)
        if variable is None:
            continue  # sub-index 0 is too large: a fault of its own already
        value = variable.current.number if variable.current else None
        if variable.data_type != UNSIGNED32 or not isinstance(value, int):
            seen = None if value is None else str(value)
            fault(variable.section, _key(variable), seen, "an UNSIGNED32: index, sub-index and bits")
            continue
        total += value & 0xFF
        _mapped_object(file, direction, variable, value, fault)
    most = 8 * _frame_bytes(file)
    if total > most:
        seen = f"{total} bits mapped in all"
        fault(mapping.section, "", seen, f"at most {most}")


def _frame_bytes(file: EdsFile) -> int:
    """Return the most bytes of a frame: what a board for CAN FD says, else those of classic CAN."""
    variable = _frame_bytes_variable(file)
    number = variable.current.number if variable and variable.current else None
    return number if isinstance(number, int) else CLASSIC_BYTES


def _frame_bytes_variable(file: EdsFile) -> Variable | None:
    for entry in file.objects.values():
        if entry.name == FRAME_BYTES.object:
            return next((v for v in entry.variables.values() if v.name == FRAME_BYTES.member), None)
    return None


def _frame_lengths(file: EdsFile, fault: Any) -> None:
    variable = _frame_bytes_variable(file)
    number = _frame_bytes(file)
    if variable is not None and number not in LENGTHS[CLASSIC_BYTES:]:
        known = ", ".join(map(str, LENGTHS[CLASSIC_BYTES:]))
        fault(variable.section, _key(variable), number, f"a length of a frame: {known}")


def _mapped_object(file: EdsFile, direction: Direction, variable: Variable, value: int, fault: Any) -> None:
    """Check one entry of a mapping: the object is there, may be mapped this way, and is that long."""
    index, sub, bits = split_mapping(value)
    seen, key = f"0x{value:08X}", _key(variable)
    if value == 0:
        fault(variable.section, key, seen, "an object, or a smaller number in sub-index 0")
        return
    if index <= MAX_DUMMY:
        dummies = file.section("DummyUsage")
        if index not in TYPES or dummies is None or parse_integer(dummies.get(f"Dummy{index:04X}")) != 1:
            fault(variable.section, key, seen, f"Dummy{index:04X}=1 in [DummyUsage], or an object")
        elif bits != TYPES[index].bits:
            fault(
                variable.section,
                key,
                seen,
                f"{TYPES[index].bits} bits (0x{TYPES[index].bits:02X})",
            )
        return
    target = file.variable(index, sub)
    if target is None:
        fault(variable.section, key, seen, f"an object that exists, not 0x{index:04X}:{sub:02X}")
        return
    if not target.mappable:
        fault(variable.section, key, seen, f"an object with PDOMapping=1, not [{target.section}]")
    if bits != target.bits:
        wanted = f"{target.bits} bits (0x{target.bits:02X}), the length of [{target.section}]"
        fault(variable.section, key, seen, wanted)
    if direction is Direction.TPDO and target.access in ("wo", "rww"):
        fault(variable.section, key, seen, f"an object to read; [{target.section}] is {target.access}")
    if direction is Direction.RPDO and target.access in ("ro", "const", "rwr"):
        fault(variable.section, key, seen, f"an object to write; [{target.section}] is {target.access}")


def _identifiers(file: EdsFile, fault: Any) -> None:
    """No PDO on a restricted identifier, and no identifier used twice, whatever the node-ID."""
    found = []
    for direction in Direction:
        for entry in _communication(file, direction):
            identifier = _identifier(entry.variables.get(cia.PDO_COB_ID))
            if identifier is None:
                continue
            found.append(identifier)
            for restricted in cia.RESTRICTED_IDS:
                ids = identifier.range()
                if ids[0] < restricted.stop and ids[-1] >= restricted.start:
                    ends = f"0x{restricted.start:03X}-0x{restricted.stop - 1:03X}"
                    variable = identifier.variable
                    fault(variable.section, _key(variable), str(identifier), f"an identifier outside {ends}")
    for index, sub in ((cia.SYNC_COB_ID, 0), (cia.EMCY_COB_ID, 0), (cia.SDO_SERVER, 1), (cia.SDO_SERVER, 2)):
        identifier = _identifier(file.variable(index, sub))
        if identifier is not None:
            found.append(identifier)
    for first, second in combinations(found, 2):
        node_id = _clash(first, second)
        if node_id is not None:
            place = f" on node {node_id}" if node_id else ""
            wanted = f"another: [{first.variable.section}] has {first}{place}"
            fault(second.variable.section, _key(second.variable), str(second), wanted)


def _identifier(variable: Variable | None) -> _Identifier | None:
    """Return the identifier of an object in use; None if it is switched off or has 29 bits."""
    value: Value | None = variable.current if variable else None
    if variable is None or value is None or not isinstance(value.number, int):
        return None
    sync = variable.index == cia.SYNC_COB_ID  # bit 31 has no meaning there
    if value.number & cia.COB_ID_EXTENDED or (value.number & cia.COB_ID_INVALID and not sync):
        return None
    return _Identifier(variable, value.number & cia.COB_ID_MASK_11, value.relative)


def _clash(first: _Identifier, second: _Identifier) -> int | None:
    """Return the node-ID on which two identifiers are one, 0 if on all; None if on none."""
    if first.relative == second.relative:
        return 0 if first.base == second.base else None
    relative, absolute = (first, second) if first.relative else (second, first)
    node_id = absolute.base - relative.base
    return node_id if 1 <= node_id <= 127 else None


def _communication(file: EdsFile, direction: Direction) -> list[Entry]:
    first = direction.communication
    return [entry for i, entry in sorted(file.objects.items()) if first <= i < first + cia.MAX_PDOS]


def _key(variable: Variable) -> str:
    return "DefaultValue" if variable.value is None else "ParameterValue"


PDO_RULES: Final = (_pdo_counts, _frame_lengths, _pdos, _identifiers)
