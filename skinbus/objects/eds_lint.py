"""Lint of EDS and DCF files: everything that reading does not check and ``dcfchk`` lets pass.

Faults read ``[section] key: is <seen>; wanted <wanted>``, all of a file at once. Rules on PDOs and
identifiers are in ``eds_lint_pdo``. Source: CiA 306-1, 4.6; CiA 301, 7.4.3 (sub-index 0), 7.5.
"""

from __future__ import annotations

import re
from difflib import get_close_matches
from typing import Any, Final

from skinbus.errors import Fault, FaultList
from skinbus.objects import cia
from skinbus.objects.eds_file import LISTS, MAX_SECTIONS, RECORD, EdsFile, Entry, Variable
from skinbus.objects.eds_lint_pdo import PDO_RULES
from skinbus.objects.eds_values import TYPES, UNSIGNED8, UNSIGNED16, UNSIGNED32, VISIBLE_STRING, parse_integer

MANDATORY_SECTIONS: Final = ("FileInfo", "DeviceInfo", "MandatoryObjects")
MANDATORY_OBJECTS: Final = (cia.DEVICE_TYPE, cia.ERROR_REGISTER, cia.IDENTITY)
MAX_NAME: Final = 241
"""Characters of a ParameterName (CiA 306-1, 4.6.3.2)."""

MAX_STRANGE: Final = 1000
"""Unknown keys that are compared with the known ones, which takes 0.1 ms each."""

_KEYS: Final = (
    *("SubNumber", "ParameterName", "ObjectType", "DataType", "AccessType", "LowLimit", "HighLimit"),
    *("DefaultValue", "PDOMapping", "ObjFlags", "CompactSubObj", "ParameterValue", "UploadFile"),
    *("DownloadFile", "Denotation", "ParamRefd", "Unit", "Factor", "Description", "StorageLocation"),
)
_KNOWN_KEYS: Final = {key.lower() for key in _KEYS}
_OBJECT_LIKE = re.compile(r"[0-9a-f]{4}(sub[0-9a-f]{1,2}|name|value|denotation|objectlinks)?")

# Data types that CiA 301 fixes; sub-indices of all array elements are those of -1.
_TYPES: Final[dict[tuple[int, int], int]] = {
    (cia.DEVICE_TYPE, 0): UNSIGNED32,
    (cia.ERROR_REGISTER, 0): UNSIGNED8,
    (cia.ERROR_HISTORY, -1): UNSIGNED32,
    (cia.SYNC_COB_ID, 0): UNSIGNED32,
    (cia.SYNC_PERIOD, 0): UNSIGNED32,
    (cia.SYNC_WINDOW, 0): UNSIGNED32,
    (cia.DEVICE_NAME, 0): VISIBLE_STRING,
    (cia.HARDWARE_VERSION, 0): VISIBLE_STRING,
    (cia.SOFTWARE_VERSION, 0): VISIBLE_STRING,
    (cia.GUARD_TIME, 0): UNSIGNED16,
    (cia.LIFE_TIME_FACTOR, 0): UNSIGNED8,
    (cia.STORE_PARAMETERS, -1): UNSIGNED32,
    (cia.RESTORE_DEFAULTS, -1): UNSIGNED32,
    (cia.TIME_COB_ID, 0): UNSIGNED32,
    (cia.HIGH_RESOLUTION_TIME, 0): UNSIGNED32,
    (cia.EMCY_COB_ID, 0): UNSIGNED32,
    (cia.EMCY_INHIBIT, 0): UNSIGNED16,
    (cia.HEARTBEAT_CONSUMER, -1): UNSIGNED32,
    (cia.HEARTBEAT_PRODUCER, 0): UNSIGNED16,
    (cia.IDENTITY, -1): UNSIGNED32,
    (cia.SYNC_COUNTER_OVERFLOW, 0): UNSIGNED8,
    (cia.VERIFY_CONFIGURATION, -1): UNSIGNED32,
    (cia.ERROR_BEHAVIOR, -1): UNSIGNED8,
}


def lint(file: EdsFile) -> FaultList:
    """Return every fault of a file, those of its reading first."""
    faults = FaultList(file.faults)
    if not file.sections:  # it is no EDS, and that was said
        return faults

    def fault(section: str, key: str, seen: Any, wanted: str) -> None:
        faults.append(Fault(f"[{section}] {key}" if key else f"[{section}]", seen, wanted))

    for rule in (*_RULES, *PDO_RULES):
        rule(file, fault)
    once = FaultList(dict.fromkeys(faults))
    once.n_more += faults.n_more
    return once


def _mandatory(file: EdsFile, fault: Any) -> None:
    for name in MANDATORY_SECTIONS:
        if file.section(name) is None:
            fault(name, "", None, "this section")
    for index in MANDATORY_OBJECTS:
        if index not in file.objects:
            fault(f"{index:04X}", "", None, "this object: CiA 301 makes it mandatory")
    if cia.IDENTITY in file.objects and file.variable(cia.IDENTITY, cia.IDENTITY_VENDOR) is None:
        fault(f"{cia.IDENTITY:04X}sub1", "", None, "the vendor-ID: CiA 301 makes it mandatory")


def _section_names(file: EdsFile, fault: Any) -> None:
    for name, section in file.sections.items():
        if re.match(r"[0-9a-f]{4}", name) and not _OBJECT_LIKE.fullmatch(name):
            fault(section.name, "", None, "a section such as [1A00], [1A00sub1] or [1A00Name]")


def _keys(file: EdsFile, fault: Any) -> None:
    n_strange = 0
    for name, section in file.sections.items():
        if not re.fullmatch(r"[0-9a-f]{4}(sub[0-9a-f]{1,2})?", name):
            continue
        for key, text in section.keys.items():
            if key not in _KNOWN_KEYS and n_strange < MAX_STRANGE:
                n_strange += 1
                near = get_close_matches(key, _KNOWN_KEYS, 1, 0.8)
                if near:  # others are vendors' own keys
                    meant = next(k for k in _KEYS if k.lower() == near[0])
                    fault(section.name, section.spelling[key], text, f"the key {meant}")


def _lists(file: EdsFile, fault: Any) -> None:
    """Each object stands in one list, the right one, and each list counts its objects."""
    listed: dict[int, str] = {}
    for name in LISTS:
        section = file.section(name)
        if section is None:
            continue
        if len(section.keys) > MAX_SECTIONS:
            fault(name, "", None, f"at most {MAX_SECTIONS} objects")
            continue
        count = parse_integer(section.get("SupportedObjects"))
        numbered = {
            parse_integer(key): text for key, text in section.keys.items() if key != "supportedobjects"
        }
        if count != len(numbered):
            seen = section.get("SupportedObjects") or None
            fault(name, "SupportedObjects", seen, f"{len(numbered)}, the number of objects listed")
        for place in range(1, len(numbered) + 1):
            if place not in numbered:
                fault(name, str(place), None, "an index: the list is numbered from 1 without a gap")
        for number, text in numbered.items():
            index = parse_integer(text)
            if index is None:
                fault(name, str(number), text, "an index such as 0x1018")
            elif index not in file.objects:
                fault(name, str(number), text, f"a section [{index:04X}] for it")
            elif index in listed:
                fault(name, str(number), text, f"it once; it is in [{listed[index]}] already")
            elif _list_of(index) != name:
                fault(name, str(number), text, f"it in [{_list_of(index)}]")
            if index is not None:
                listed.setdefault(index, name)
    for index, entry in file.objects.items():
        if index >= 0x1000 and index not in listed:  # below are types of the file's own
            fault(entry.section, "", None, f"its index in [{_list_of(index)}]")


def _list_of(index: int) -> str:
    if index in MANDATORY_OBJECTS:
        return LISTS[0]
    return LISTS[2] if 0x2000 <= index < 0x6000 else LISTS[1]


def _groups(file: EdsFile, fault: Any) -> None:
    """SubNumber counts the sub-objects; sub-index 0 is an UNSIGNED8 that says the highest of them."""
    for entry in file.objects.values():
        if not entry.is_group:
            continue
        if not entry.compact and entry.sub_number != len(entry.variables):
            seen = None if entry.sub_number is None else entry.sub_number
            fault(entry.section, "SubNumber", seen, f"{len(entry.variables)}, the number of sub-objects")
        sub0 = entry.variables.get(0)
        if sub0 is None:
            fault(f"{entry.section}sub0", "", None, "the number of entries, UNSIGNED8")
        elif not sub0.generated:
            _sub_index_0(entry, sub0, fault)


def _sub_index_0(entry: Entry, sub0: Variable, fault: Any) -> None:
    highest = max(sub for sub in entry.variables if sub < 0xFF)
    if sub0.data_type != UNSIGNED8:
        fault(sub0.section, "DataType", f"0x{sub0.data_type:04X}", "0x0005, UNSIGNED8")
        return
    key = "DefaultValue" if sub0.value is None else "ParameterValue"
    number = None if sub0.current is None else sub0.current.number
    counts = entry.index == cia.ERROR_HISTORY or sub0.access not in ("ro", "const")
    if not isinstance(number, int):
        if not counts:
            fault(sub0.section, key, None, f"{highest}, the highest sub-index")
    elif number > highest:
        fault(sub0.section, key, number, f"at most {highest}, the highest sub-index")
    elif number != highest and not counts:
        fault(sub0.section, key, number, f"{highest}, the highest sub-index")


def _known_types(file: EdsFile, fault: Any) -> None:
    for (index, sub), data_type in _TYPES.items():
        entry = file.objects.get(index)
        if entry is None:
            continue
        if sub == 0 and entry.is_group:
            fault(entry.section, "ObjectType", f"0x{entry.object_type:X}", "0x7, VAR")
            continue
        if sub < 0 and not entry.is_group:
            fault(entry.section, "ObjectType", f"0x{entry.object_type:X}", "0x8 or 0x9, with sub-objects")
            continue
        wanted = [sub] if sub >= 0 else [s for s in entry.variables if 0 < s < 0xFF]
        for s in wanted:
            variable = entry.variables[s]
            if variable.data_type != data_type and not (variable.generated and s > 1):
                name = TYPES[data_type].name
                fault(
                    variable.section, "DataType", f"0x{variable.data_type:04X}", f"0x{data_type:04X}, {name}"
                )


def _limits(file: EdsFile, fault: Any) -> None:
    for variable in _variables(file):
        low, high = variable.low, variable.high
        if low is not None and high is not None and low > high:
            fault(variable.section, "LowLimit", low, f"at most {high:g}, the high limit")
            continue
        for key, value in (("DefaultValue", variable.default), ("ParameterValue", variable.value)):
            if value is None or value.relative or not isinstance(value.number, int | float):
                continue
            if low is not None and value.number < low:
                fault(variable.section, key, value.number, f"at least {low:g}, the low limit")
            if high is not None and value.number > high:
                fault(variable.section, key, value.number, f"at most {high:g}, the high limit")


def _names(file: EdsFile, fault: Any) -> None:
    """Names are short; a manufacturer's objects, and members of its records, are distinguished by name."""
    seen: dict[str, str] = {}
    for entry in file.objects.values():
        if len(entry.name) > MAX_NAME:
            fault(entry.section, "ParameterName", entry.name[:20] + "...", f"at most {MAX_NAME} characters")
        if 0x2000 <= entry.index < 0x6000 and seen.setdefault(entry.name, entry.section) != entry.section:
            fault(
                entry.section, "ParameterName", entry.name, f"a name of its own; [{seen[entry.name]}] has it"
            )
        members: dict[str, str] = {}
        for sub, variable in entry.variables.items():
            if entry.object_type != RECORD or not 0x2000 <= entry.index < 0x6000:
                continue
            name = variable.name
            if members.setdefault(name, variable.section) != variable.section and sub:
                fault(variable.section, "ParameterName", name, f"a name of its own; [{members[name]}] has it")


def _device_info(file: EdsFile, fault: Any) -> None:
    section = file.section("DeviceInfo")
    if section is None:
        return
    rates = {key: text for key, text in section.keys.items() if key.startswith("baudrate_")}
    if not any(parse_integer(text) for text in rates.values()):
        fault(section.name, "BaudRate_*", None, "1 for at least one of 10, 20, 50, 125, 250, 500, 800, 1000")
    for key, sub in (
        ("VendorNumber", cia.IDENTITY_VENDOR),
        ("ProductNumber", cia.IDENTITY_PRODUCT),
        ("RevisionNumber", cia.IDENTITY_REVISION),
    ):
        text = section.get(key)
        number = parse_integer(text) if text else 0
        if number is None:
            fault(section.name, key, text, "an integer")
            continue
        variable = file.variable(cia.IDENTITY, sub)
        identity = variable.current.number if variable and variable.current else 0
        if number and isinstance(identity, int) and identity and number != identity:
            fault(section.name, key, text, f"0x{identity:X}, as in [1018sub{sub}]")
    if section.get("CompactPDO") and parse_integer(section.get("CompactPDO")) != 0:
        fault(section.name, "CompactPDO", section.get("CompactPDO"), "0: every PDO in a section of its own")


def _counted_lines(file: EdsFile, fault: Any) -> None:
    """Comments count their lines; dummies are switched by 0 or 1."""
    comments, dummies = file.section("Comments"), file.section("DummyUsage")
    if comments:
        lines = sum(key.startswith("line") and key != "lines" for key in comments.keys)
        if parse_integer(comments.get("Lines")) != lines:
            fault(comments.name, "Lines", comments.get("Lines") or None, f"{lines}, the number of lines")
    for key, text in dummies.keys.items() if dummies else ():
        spelling = dummies.spelling[key] if dummies else key
        if not re.fullmatch(r"dummy[0-9a-f]{4}", key):
            fault("DummyUsage", spelling, text, "Dummy0001 to Dummy001F")
        elif parse_integer(text) not in (0, 1):
            fault("DummyUsage", spelling, text, "0 or 1")


def _variables(file: EdsFile) -> list[Variable]:
    return [v for entry in file.objects.values() for v in entry.variables.values()]


_RULES: Final = (
    _mandatory,
    _section_names,
    _keys,
    _lists,
    _groups,
    _known_types,
    _limits,
    _names,
    _device_info,
    _counted_lines,
)
