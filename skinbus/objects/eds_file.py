"""An EDS or DCF file as typed entries: every number read as CiA 306 writes it, every fault kept.

Unlike a plain INI reader it reads octal numbers, all spellings of ``$NODEID``, REAL32 and signed numbers as
bit patterns, compact sub-objects with their names and values, and files that are not UTF-8.

Source: CiA 306-1, 4.6 and 4.7 (object sections), 4.6.4 (compact storage).
"""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

from skinbus.errors import EdsError, Fault, FaultList
from skinbus.file_bytes import read_bytes
from skinbus.objects.eds_values import (
    DOMAIN_TYPE,
    TYPES,
    UNSIGNED8,
    Value,
    parse_integer,
    parse_value,
)

MAX_BYTES = 1 << 20
"""The largest EDS files of drives have half of this."""

MAX_SECTIONS = 10_000
"""Twice as many as the largest drives have."""

VAR = 0x7
ARRAY = 0x8
RECORD = 0x9
DOMAIN = 0x2
GROUP_TYPES = (ARRAY, RECORD)
OBJECT_TYPES = (0x0, DOMAIN, 0x5, 0x6, VAR, *GROUP_TYPES)
"""Of CiA 301, with NULL, DEFTYPE and DEFSTRUCT."""
ACCESS_TYPES = ("ro", "wo", "rw", "rwr", "rww", "const")

_SECTION = re.compile(r"\[(?P<name>[^\]]*)\]")
OBJECT = re.compile(r"(?P<index>[0-9a-f]{4})(?:sub(?P<sub>[0-9a-f]{1,2}))?")
"""Name of the section of an object, in lower case."""


@dataclass(slots=True)
class Section:
    """One section of the file: its name as written, its keys in lower case."""

    name: str
    keys: dict[str, str] = field(default_factory=dict)
    spelling: dict[str, str] = field(default_factory=dict)
    """Keys as the file spells them."""

    def get(self, key: str) -> str:
        """Return the text after ``key=``, empty when there is none."""
        return self.keys.get(key.lower(), "")


@dataclass(slots=True)
class Variable:
    """One value that can be read or written: an object of type VAR, or a sub-object."""

    section: str
    index: int
    sub: int
    name: str
    data_type: int
    access: str
    mappable: bool
    low: int | float | None
    high: int | float | None
    default: Value | None
    value: Value | None
    """ParameterValue of a DCF; it wins over the default."""
    generated: bool = False
    """Stands in no section of its own (compact sub-objects)."""

    @property
    def bits(self) -> int:
        """Length on the wire; 0 for strings and domains."""
        return TYPES[self.data_type].bits

    @property
    def current(self) -> Value | None:
        """ParameterValue if there is one, else the default."""
        return self.default if self.value is None else self.value

    @property
    def number(self) -> int | None:
        """The current value if it is an integer; of a relative one what is added to the node-ID."""
        number = self.current.number if self.current else None
        return number if isinstance(number, int) else None


@dataclass(slots=True)
class Entry:
    """One object: a variable (``variables[0]``) or a group of them by sub-index."""

    section: str
    index: int
    name: str
    object_type: int
    variables: dict[int, Variable] = field(default_factory=dict)

    @property
    def is_group(self) -> bool:
        """True for arrays and records."""
        return self.object_type in GROUP_TYPES


@dataclass(slots=True)
class EdsFile:
    """Sections and objects of one file, with the faults that reading it turned up."""

    name: str
    sections: dict[str, Section] = field(default_factory=dict)
    """By name in lower case."""
    objects: dict[int, Entry] = field(default_factory=dict)
    faults: FaultList = field(default_factory=FaultList)
    n_compact: int = 0
    """Sub-objects of compact arrays so far."""

    def section(self, name: str) -> Section | None:
        """Return a section whatever its case."""
        return self.sections.get(name.lower())

    def variable(self, index: int, sub: int = 0) -> Variable | None:
        """Return one variable, None when the file does not have it."""
        entry = self.objects.get(index)
        return None if entry is None else entry.variables.get(sub)

    def fault(self, section: str, key: str, seen: object, wanted: str) -> None:
        """Keep one fault."""
        self.faults.add(f"[{section}] {key}" if key else f"[{section}]", seen, wanted)

    def fault_at(self, variable: Variable, seen: object, wanted: str) -> None:
        """Keep one fault of the current value of a variable."""
        self.fault(
            variable.section, "DefaultValue" if variable.value is None else "ParameterValue", seen, wanted
        )

    def integer(self, section: str, key: str) -> int | None:
        """Return an integer of a section; None without one; a malformed one is a fault."""
        found = self.section(section)
        text = found.get(key) if found else ""
        number = parse_integer(text)
        if text and number is None:
            self.fault(section, key, text, "an integer: 10, 0x0A or 012")
        return number


def read_file(path: Path) -> EdsFile:
    """Read an EDS or DCF file; what is wrong in it is in the result.

    Raises:
        EdsError: it cannot be read, or is larger than any EDS.
    """
    text, _ = text_of(path)
    return read_text(text, name=str(path))


def text_of(path: Path) -> tuple[str, str]:
    """Return the text of a file and its encoding: UTF-8 or, failing that, Latin-1, which any bytes are.

    Raises:
        EdsError: it cannot be read, or is larger than any EDS.
    """
    raw = read_bytes(path, MAX_BYTES, EdsError)
    if raw.startswith(codecs.BOM_UTF8):
        return raw.decode("utf-8-sig", errors="replace"), "utf-8-sig"
    try:
        return raw.decode("utf-8"), "utf-8"
    except UnicodeDecodeError:
        return raw.decode("latin-1"), "latin-1"


def read_text(text: str, *, name: str) -> EdsFile:
    """Read the text of an EDS or DCF file; faults are in the result.

    Of a file that has none of the sections of an EDS nothing is quoted: it may be anything.
    """
    file = EdsFile(name)
    _read_sections(file, text)
    if not any(n in ("fileinfo", "deviceinfo") or OBJECT.fullmatch(n) for n in file.sections):
        return EdsFile(name, faults=FaultList([Fault("file", None, "an EDS or DCF: it has no [FileInfo]")]))
    matches = [(section, OBJECT.fullmatch(name)) for name, section in file.sections.items()]
    for section, match in matches:
        if match and match["sub"] is None:
            _read_object(file, section, int(match["index"], 16))
    for section, match in matches:
        if match and match["sub"] is not None:
            _read_sub_object(file, section, int(match["index"], 16), int(match["sub"], 16))
    return file


def _read_sections(file: EdsFile, text: str) -> None:
    section: Section | None = None
    for number, line in enumerate(text.splitlines(), 1):
        if len(file.sections) > MAX_SECTIONS or file.faults.n_more > MAX_SECTIONS:
            file.faults.add(f"line {number}", None, f"at most {MAX_SECTIONS} sections, or faults")
            return
        line = line.strip()
        if not line or line.startswith((";", "#")):
            continue
        head = _SECTION.match(line)
        if head:
            section = Section(head["name"].strip())
            if section.name.lower() in file.sections:
                file.fault(section.name, "", f"again on line {number}", "each section once")
                section = Section(section.name)  # its keys are read, and dropped
            else:
                file.sections[section.name.lower()] = section
            continue
        key, equals, value = line.partition("=")
        key = key.strip()
        if not equals or not key or section is None:
            file.faults.add(f"line {number}", None, "[section] or key=value")
        elif key.lower() in section.keys:
            file.fault(section.name, key, value.strip(), "each key once in a section")
        else:
            section.keys[key.lower()] = value.strip()
            section.spelling[key.lower()] = key


def _read_object(file: EdsFile, section: Section, index: int) -> None:
    name = _name(file, section)
    object_type = file.integer(section.name, "ObjectType") or VAR
    if object_type not in OBJECT_TYPES:
        file.fault(section.name, "ObjectType", section.get("ObjectType"), "0x7 VAR, 0x8 ARRAY or 0x9 RECORD")
        object_type = VAR
    entry = Entry(section.name, index, name, object_type)
    file.objects[index] = entry
    if not entry.is_group:
        entry.variables[0] = _read_variable(file, section, index, 0, name, object_type)
    elif section.get("CompactSubObj"):
        _expand_compact(file, section, entry)


def _read_sub_object(file: EdsFile, section: Section, index: int, sub: int) -> None:
    entry = file.objects.get(index)
    if entry is None or not entry.is_group:
        file.fault(section.name, "", None, f"a section [{index:04X}] with ObjectType 0x8 or 0x9 for it")
        return
    if sub in entry.variables:
        file.fault(section.name, "", None, f"no section of its own: [{index:04X}] is compact")
        return
    object_type = file.integer(section.name, "ObjectType") or VAR
    name = _name(file, section)
    entry.variables[sub] = _read_variable(file, section, index, sub, name, object_type)


def _name(file: EdsFile, section: Section) -> str:
    name = section.get("ParameterName")
    if not name:
        file.fault(section.name, "ParameterName", None, "a name")
        return section.name
    return name


def _read_variable(
    file: EdsFile, section: Section, index: int, sub: int, name: str, object_type: int
) -> Variable:
    """Return the variable that a section describes; what is wrong with it becomes faults."""
    data_type = _data_type(file, section, object_type)
    access = section.get("AccessType").lower()
    if access not in ACCESS_TYPES:
        wanted = "one of " + ", ".join(ACCESS_TYPES)
        file.fault(section.name, "AccessType", section.get("AccessType") or None, wanted)
        access = "rw"
    mappable = parse_integer(section.get("PDOMapping") or "0")
    if mappable not in (0, 1):
        file.fault(section.name, "PDOMapping", section.get("PDOMapping"), "0 or 1")
    values: dict[str, Value | None] = {}
    for key in ("LowLimit", "HighLimit", "DefaultValue", "ParameterValue"):
        text = section.get(key)
        parsed = parse_value(text, data_type) if text and data_type else None
        if isinstance(parsed, Value) and key.endswith("Limit"):
            is_plain = not parsed.relative and isinstance(parsed.number, int | float)
            parsed = parsed if is_plain else "a plain number"
        if isinstance(parsed, str):
            file.fault(section.name, key, text, parsed)
        values[key] = parsed if isinstance(parsed, Value) else None
    low, high, default, value = values.values()
    return Variable(
        section.name,
        index,
        sub,
        name,
        data_type or UNSIGNED8,
        access,
        bool(mappable),
        low.number if low else None,  # type: ignore[arg-type]  # a number, see above
        high.number if high else None,  # type: ignore[arg-type]
        default,
        value,
    )


def _data_type(file: EdsFile, section: Section, object_type: int) -> int:
    """Return the data type, 0 after a fault; types of the file's own (CANFestival) are looked up."""
    given = section.get("DataType")
    if not given and object_type == DOMAIN:
        return DOMAIN_TYPE
    data_type = file.integer(section.name, "DataType") or 0
    if data_type > max(TYPES) and file.section(f"{data_type:X}sub1"):
        data_type = file.integer(f"{data_type:X}sub1", "DefaultValue") or data_type
    if data_type in TYPES:
        return data_type
    if not given or parse_integer(given) is not None:
        file.fault(section.name, "DataType", given or None, "a data type of CiA 301, such as 0x0005")
    return 0


def _expand_compact(file: EdsFile, section: Section, entry: Entry) -> None:
    """Write out the sub-objects of a compact array: sub 0, and 1..n alike but for names and values."""
    count = file.integer(section.name, "CompactSubObj") or 0
    file.n_compact += count
    if not 1 <= count <= 254 or file.n_compact > MAX_SECTIONS:
        wanted = f"1 to 254, {MAX_SECTIONS} in a file"
        file.fault(section.name, "CompactSubObj", section.get("CompactSubObj"), wanted)
        return
    model = replace(_read_variable(file, section, entry.index, 1, entry.name, VAR), generated=True)
    names = _compact_list(file, f"{section.name}Name", count)
    values = _compact_list(file, f"{section.name}Value", count)
    entry.variables[0] = replace(
        model, sub=0, name="Highest sub-index supported", data_type=UNSIGNED8, access="const",
        mappable=False, low=None, high=None, default=Value(count), value=None,
    )  # fmt: skip
    for sub in range(1, count + 1):
        value = parse_value(values[sub], model.data_type) if sub in values else model.value
        if isinstance(value, str):
            file.fault(f"{section.name}Value", str(sub), values[sub], value)
            value = model.value
        name = names.get(sub, f"{entry.name} {sub}")
        entry.variables[sub] = replace(model, sub=sub, name=name, value=value)


def _compact_list(file: EdsFile, name: str, count: int) -> dict[int, str]:
    """Return the numbered lines of a [xxxxName] or [xxxxValue] section; it may leave numbers out."""
    section = file.section(name)
    lines = {}
    for key, text in section.keys.items() if section else ():
        sub = parse_integer(key)
        if key == "nrofentries" or not text:
            continue
        if sub is None or not 1 <= sub <= count:
            file.fault(name, key, text, f"a sub-index from 1 to {count}")
        else:
            lines[sub] = text
    return lines
