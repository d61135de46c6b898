"""DBC files: the PDOs of devices as messages and signals, for tools that decode frames by name.

Signals are little-endian (``@1``), as PDOs are: an object at bit k of the PDO starts at bit k. A physical
value is ``raw * factor + offset``. Source: the format as cantools 40 and Vector's DBC File Format 1.0.5
describe it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from canopen.objectdictionary import ObjectDictionary, ODVariable

from skinbus.can.fd import CLASSIC_BYTES
from skinbus.objects import cia
from skinbus.objects.contacts import ContactState
from skinbus.objects.eds_values import REAL32, REAL64
from skinbus.objects.pdo import Direction, PdoEntry, PdoMap

LONGEST_NAME: Final = 32
"""Characters of a name in a DBC."""

LINK_AND_STATE: Final = "Link and state"
"""An object of two halves of a byte, see ``objects.contacts``."""

_UNIT: Final = re.compile(r"(.+?) (\d+(?:\.\d+)?)?(mm2|mm|um|ns|us|ms|Pa|N)")
"""A name of ours that says what it counts in: "Force 0.01N", "Latency 10us", "Compute time us"."""

_REAL: Final = {REAL32: 1, REAL64: 2}
"""SIG_VALTYPE_ of REAL32 and REAL64."""

_EXTENDED: Final = 0x8000_0000


@dataclass(frozen=True, slots=True)
class Scale:
    """What a raw value is in its unit."""

    factor: float = 1.0
    offset: float = 0.0
    unit: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class DbcNode:
    """A node of a DBC."""

    name: str
    comment: str
    od: ObjectDictionary
    pdos: Sequence[tuple[Direction, PdoMap]]
    """Those that are sent and received."""
    readings: Mapping[int, Scale] = field(default_factory=dict)
    """Of its readings, by sub-index."""
    links: Sequence[str] = ()
    """Names of the links, of a master."""
    cycle_ms: int = 0
    """Time between two synchronous TPDOs, 0 for not known."""


@dataclass(frozen=True, slots=True)
class _Signal:
    name: str
    start: int
    bits: int
    signed: bool
    scale: Scale
    comment: str
    real: int = 0
    choices: Mapping[int, str] = field(default_factory=dict)


def dbc(devices: Sequence[DbcNode], *, master: str, bitrate: int, data_bitrate: int | None = None) -> str:
    """Return the PDOs of the devices on one bus as the text of a DBC file.

    master:       name of the device that receives what the others send; it may be one of ``devices``
    bitrate:      bit/s
    data_bitrate: bit/s of CAN FD; None for classic CAN
    """
    names = _unique([_identifier(name) for name in [*(device.name for device in devices), master]])
    names[-1] = next((names[k] for k, device in enumerate(devices) if device.name == master), names[-1])
    lines = ['VERSION ""', "", "NS_ :", *(f"\t{word}" for word in _SECTIONS), "", "BS_:", ""]
    lines += [f"BU_: {' '.join(dict.fromkeys(names))}", ""]
    comments, choices, reals, attributes = [], [], [], []
    for device, name in zip(devices, names, strict=False):
        comments.append(f"CM_ BU_ {name} {_quoted(device.comment)};")
    used: set[str] = set()
    for device, node in zip(devices, names, strict=False):
        for direction, pdo in device.pdos:
            sender, receiver = (node, names[-1]) if direction is Direction.TPDO else (names[-1], node)
            receiver = "Vector__XXX" if receiver == sender else receiver
            number = pdo.cob_id | (_EXTENDED if pdo.extended else 0)
            title = _title(device, direction, pdo, node, used)
            lines.append(f"BO_ {number} {title}: {pdo.length} {sender}")
            for signal in _signals(device, pdo):
                low, high = _limits(signal)
                lines.append(
                    f" SG_ {signal.name} : {signal.start}|{signal.bits}@1{'-' if signal.signed else '+'} "
                    f"({signal.scale.factor!r},{signal.scale.offset!r}) [{low!r}|{high!r}] "
                    f"{_quoted(signal.scale.unit)} {receiver}"
                )
                comments.append(f"CM_ SG_ {number} {signal.name} {_quoted(signal.comment)};")
                if signal.choices:
                    pairs = " ".join(f"{value} {_quoted(text)}" for value, text in signal.choices.items())
                    choices.append(f"VAL_ {number} {signal.name} {pairs} ;")
                if signal.real:
                    reals.append(f"SIG_VALTYPE_ {number} {signal.name} : {signal.real};")
            lines.append("")
            comments.append(f"CM_ BO_ {number} {_quoted(_about(device, direction, pdo))};")
            attributes.append(f'BA_ "VFrameFormat" BO_ {number} {_frame_format(pdo)};')
            if device.cycle_ms and direction is Direction.TPDO and 1 <= pdo.transmission_type <= 240:
                cycle = device.cycle_ms * pdo.transmission_type
                attributes.append(f'BA_ "GenMsgCycleTime" BO_ {number} {cycle};')
    lines += [*comments, "", *_ATTRIBUTES]
    lines.append(f'BA_ "BusType" {_quoted("CAN FD" if data_bitrate else "CAN")};')
    lines.append(f'BA_ "Baudrate" {bitrate};')
    if data_bitrate:
        lines.append(f'BA_ "BaudrateCANFD" {data_bitrate};')
    return "\n".join([*lines, *attributes, "", *choices, *reals]) + "\n"


_SECTIONS: Final = ("CM_", "BA_DEF_", "BA_", "VAL_", "BA_DEF_DEF_", "SIG_VALTYPE_")

_FRAME_FORMATS: Final = (
    "StandardCAN",
    "ExtendedCAN",
    *("reserved",) * 12,
    "StandardCAN_FD",
    "ExtendedCAN_FD",
)
"""Values of the attribute VFrameFormat."""

_ATTRIBUTES: Final = (
    'BA_DEF_ "BusType" STRING ;',
    'BA_DEF_ "Baudrate" INT 0 1000000;',
    'BA_DEF_ "BaudrateCANFD" INT 0 16000000;',
    'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;',
    'BA_DEF_ BO_ "VFrameFormat" ENUM ' + ",".join(f'"{name}"' for name in _FRAME_FORMATS) + ";",
    'BA_DEF_DEF_ "BusType" "CAN";',
    'BA_DEF_DEF_ "Baudrate" 1000000;',
    'BA_DEF_DEF_ "BaudrateCANFD" 0;',
    'BA_DEF_DEF_ "GenMsgCycleTime" 0;',
    'BA_DEF_DEF_ "VFrameFormat" "StandardCAN";',
)


def _frame_format(pdo: PdoMap) -> int:
    return (14 if pdo.length > CLASSIC_BYTES else 0) + pdo.extended


def _title(device: DbcNode, direction: Direction, pdo: PdoMap, node: str, used: set[str]) -> str:
    """Return the name of a message: that of the object if it maps no other, else its number."""
    objects = {entry.index for entry in pdo.entries if not entry.is_dummy}
    number = f"_{direction.name}{pdo.number}"
    name = node[: LONGEST_NAME - len(number)] + number
    if len(objects) == 1 and not device.readings:
        own = _identifier(f"{node}_{device.od.indices[objects.pop()].name}")
        name = name if own in used else own
    k, whole = 2, name
    while name in used:
        name, k = f"{whole[: LONGEST_NAME - 4]}_{k}", k + 1
    used.add(name)
    return name


def _signals(device: DbcNode, pdo: PdoMap) -> Iterator[_Signal]:
    found: list[_Signal] = []
    for entry in pdo.entries:
        if not entry.is_dummy:
            found += _signals_of(device, entry)
    names = _unique([signal.name for signal in found])
    for signal, name in zip(found, names, strict=True):
        yield _Signal(
            name,
            signal.start,
            signal.bits,
            signal.signed,
            signal.scale,
            signal.comment,
            signal.real,
            signal.choices,
        )


def _signals_of(device: DbcNode, entry: PdoEntry) -> list[_Signal]:
    """Return the signals of a mapped object, which are one but for "Link and state"."""
    variable = device.od.get_variable(entry.index, entry.sub)
    label = variable.name if variable is not None else f"object {entry.index:04X} {entry.sub}"
    where = f"0x{entry.index:04X}:{entry.sub:02X} {label}"
    if entry.sub in device.readings and entry.index in cia.READINGS:
        scale = device.readings[entry.sub]
        comment = f"{where}: pressure by offset and gain of this tactel, before its zero"
        return [_Signal(f"tactel_{entry.sub}", entry.offset, entry.bits, entry.signed, scale, comment)]
    if label == LINK_AND_STATE and entry.bits == 8:
        states = {int(state): state.name.lower() for state in ContactState}
        links = dict(enumerate(device.links[:16]))
        return [
            _Signal("link", entry.offset, 4, False, Scale(), f"{where}: link", 0, links),
            _Signal("state", entry.offset + 4, 4, False, Scale(), f"{where}: state", 0, states),
        ]
    name, scale = _scale(variable, label)
    real = _REAL.get(variable.data_type or 0, 0) if variable is not None else 0
    return [_Signal(_identifier(name), entry.offset, entry.bits, entry.signed, scale, where, real)]


def _scale(variable: ODVariable | None, label: str) -> tuple[str, Scale]:
    """Return name and scale of a value: what its EDS says of unit and factor, else what its name says."""
    if variable is not None and (variable.unit or variable.factor not in (1, None)):
        return label, Scale(float(variable.factor or 1), 0.0, variable.unit or "")
    if match := _UNIT.fullmatch(label):
        return match[1], Scale(float(match[2] or 1), 0.0, match[3])
    return label, Scale()


def _limits(signal: _Signal) -> tuple[float, float]:
    """Return the least and the greatest physical value; 0 and 0 for no limits."""
    if signal.real:
        return 0.0, 0.0
    low = -(1 << (signal.bits - 1)) if signal.signed else 0
    high = (1 << (signal.bits - signal.signed)) - 1
    ends = [raw * signal.scale.factor + signal.scale.offset for raw in (low, high)]
    return min(ends), max(ends)


def _about(device: DbcNode, direction: Direction, pdo: PdoMap) -> str:
    kind = pdo.transmission_type
    when = f"at every {kind}. SYNC" if 1 < kind <= 240 else "at every SYNC" if kind == 1 else f"type {kind}"
    return f"{direction.name} {pdo.number} of {device.name}, {when}; {device.comment}"


def _quoted(text: str) -> str:
    """Return text as a string of a DBC: printable ASCII."""
    plain = "".join(c if " " <= c <= "~" else "?" for c in text)
    return '"' + plain.replace("\\", "/").replace('"', "'") + '"'


def _identifier(text: str) -> str:
    """Return text as a C identifier of at most 32 characters."""
    name = re.sub(r"[^0-9A-Za-z_]+", "_", text).strip("_") or "x"
    return (name if not name[0].isdigit() else f"_{name}")[:LONGEST_NAME]


def _unique(names: Sequence[str]) -> list[str]:
    """Return names of which no two are the same: later ones are numbered."""
    used: set[str] = set()
    unique = []
    for name in names:
        k, own = 2, name
        while own in used:
            own, k = f"{name[: LONGEST_NAME - 4]}_{k}", k + 1
        used.add(own)
        unique.append(own)
    return unique
