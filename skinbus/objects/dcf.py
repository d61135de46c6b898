"""Device configurations: what must be downloaded to a patch, and DCF files that say so.

A configuration is every ParameterValue that differs from the value at power-on, in an order a device
takes: parameters of a PDO while it is switched off (CiA 301, 7.5.2.36), 0x1020 last of all.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from canopen.objectdictionary import ObjectDictionary, ODArray, ODRecord, ODVariable

from skinbus.errors import EdsError, FaultList
from skinbus.objects import cia
from skinbus.objects.eds import find_eds
from skinbus.objects.eds_file import read_text, text_of
from skinbus.objects.eds_text import EdsText
from skinbus.objects.eds_values import REAL32, REAL64, TYPES, Number, encode
from skinbus.objects.pdo import Direction
from skinbus.objects.profile import COMMUNICATION_CHECKSUM

_CONCISE = struct.Struct("<HBI")
"""Index, sub-index and length of an entry of a concise DCF."""
_NOT_DOWNLOADED = (cia.STORE_PARAMETERS, cia.RESTORE_DEFAULTS, cia.VERIFY_CONFIGURATION)

_VERIFIED = frozenset(
    {
        cia.SYNC_COB_ID,
        cia.SYNC_PERIOD,
        cia.SYNC_WINDOW,
        cia.EMCY_COB_ID,
        cia.HEARTBEAT_CONSUMER,
        cia.HEARTBEAT_PRODUCER,
        cia.SYNC_COUNTER_OVERFLOW,
    }
)
"""Communication objects that the pipeline depends on, beside those of the TPDOs."""


class Write(NamedTuple):
    """One SDO download."""

    index: int  # type: ignore[assignment]  # hides tuple.index, which is not used here
    sub: int
    data: bytes


class Configuration(NamedTuple):
    """What is written to a device, and the marks that show that it has been (0x1020)."""

    writes: tuple[Write, ...]
    date: int = 0
    time: int = 0
    """Both 0 when there is nothing to download."""
    communication: tuple[Write, ...] = ()
    """What the objects that ``is_verified`` names are to hold: downloads that bring each of them to it."""
    checksum: int = 0
    """Of these objects, as a board computes it."""
    checksum_index: int = 0
    """Object that holds it; 0 when the board has none."""
    window: Write | None = None
    """The synchronous window (0x1007) of the arm, which no file names: set at a boot, not in the marks."""
    checksum_before: int = 0
    """The checksum while a board holds all of it but the window."""


def configuration(od: ObjectDictionary, *, window_us: int = 0) -> Configuration:
    """Return the configuration of the device that a dictionary describes.

    ``window_us`` is what 0x1007 is to hold if no file sets it, 0 for no limit. The marks for 0x1020 are a
    fingerprint of the writes, so that they are equal if, and practically only if, the configuration is. Marks
    that a file has of its own are without what an arm file sets on top.
    """
    writes = tuple(download_plan(od))
    flat = to_concise(writes)
    date, time = (zlib.crc32(flat) or 1, zlib.adler32(flat)) if writes else (0, 0)
    verified = [v for v in _variables(od) if is_verified(v.index) and v.writable and v.readable]
    found = od.names.get(COMMUNICATION_CHECKSUM)
    window = None
    if any(v.index == cia.SYNC_WINDOW and v.value is None and not v.default for v in verified) and window_us:
        window = Write(cia.SYNC_WINDOW, 0, window_us.to_bytes(4, "little"))

    def held(write: Write) -> Write:
        return window if window is not None and write.index == window.index else write

    return Configuration(
        writes,
        date,
        time,
        communication=tuple(held(write) for write in _plan(od, verified, is_whole=True)),
        checksum=checksum(held(_write(variable)) for variable in verified),
        checksum_index=0 if found is None else found.index,
        window=window,
        checksum_before=checksum(_write(variable) for variable in verified),
    )


def is_verified(index: int) -> bool:
    """Whether the pipeline depends on an object, so that its values are verified at every boot of a patch."""
    return index in _VERIFIED or cia.TPDO_COMMUNICATION <= index < cia.TPDO_MAPPING + cia.MAX_PDOS


def checksum(values: Iterable[Write]) -> int:
    """Return the communication checksum: CRC-32 (that of zlib) over values in the order of their indices.

    They are those of all entries that can be read and written of the objects that ``is_verified`` names, as
    entries of a concise DCF: index U16, sub-index U8, length U32, value.
    """
    return zlib.crc32(_entries(values))


def repairs(configuration: Configuration, held: Mapping[tuple[int, int], bytes | None]) -> list[Write]:
    """Return the downloads that mend verified objects of which a board holds other values.

    ``held`` are these values by index and sub-index, None where there is none to read. A PDO is written as a
    whole, switched off under the identifier that it has.
    """
    parts = {_part(index) for index, _ in held}
    plan = [write for write in configuration.communication if _part(write.index) in parts]
    final = {(write.index, write.sub): write.data for write in plan}
    seen = set()
    for k, write in enumerate(plan):
        key = write.index, write.sub
        if _pdo_of(write.index) and write.index < cia.TPDO_MAPPING and write.sub == cia.PDO_COB_ID:
            if key not in seen:
                off = int.from_bytes(held.get(key) or final[key], "little") | cia.COB_ID_INVALID
                plan[k] = write._replace(data=off.to_bytes(4, "little"))
            seen.add(key)
    return plan


def _part(index: int) -> int:
    """Return the object with which another is written: the parameters of a PDO go together."""
    return index - cia.TPDO_MAPPING + cia.TPDO_COMMUNICATION if index >= cia.TPDO_MAPPING else index


def _plan(od: ObjectDictionary, variables: Iterable[ODVariable], *, is_whole: bool) -> list[Write]:
    """Return the downloads that bring these variables to their values; PDOs come last, each in its order.

    ``is_whole``: whatever a device holds, all of a PDO.
    """
    found = [(variable, _pdo_of(variable.index)) for variable in variables]
    plan = [_write(variable) for variable, pdo in found if pdo is None]
    for direction, number in dict.fromkeys(pdo for _, pdo in found if pdo):
        plan += _pdo_writes(od, direction, number, is_whole=is_whole)
    return plan


def download_plan(od: ObjectDictionary) -> list[Write]:
    """Return the downloads that turn the values at power-on into the ParameterValues."""
    return _plan(od, (v for v in _variables(od) if _differs(v)), is_whole=False)


def to_concise(writes: Sequence[Write]) -> bytes:
    """Return downloads as the concise DCF that the master's 0x1F22 holds (CiA 302-3, 4.2)."""
    return struct.pack("<I", len(writes)) + _entries(writes)


def _entries(writes: Iterable[Write]) -> bytes:
    return b"".join(_CONCISE.pack(w.index, w.sub, len(w.data)) + w.data for w in writes)


def write_dcf(
    source: str | Path,
    path: Path,
    values: Mapping[tuple[int, int], Number],
    *,
    node_id: int = 0,
) -> None:
    """Write a DCF: the text of an EDS or DCF, with ParameterValues for values by index and sub-index.

    Raises:
        EdsError: the source does not exist, or does not have an object or a value of that type.
    """
    found = find_eds(source)
    text, encoding = text_of(found)
    new = dcf_text(text, values, name=str(found), node_id=node_id, file_name=path.name)
    path.write_bytes(new.encode(encoding))


def dcf_text(
    text: str,
    values: Mapping[tuple[int, int], Number],
    *,
    name: str = "EDS",
    node_id: int = 0,
    file_name: str = "",
) -> str:
    """Return the text of a file with ParameterValues added or replaced; all else stays as it is."""
    file = read_text(text, name=name)
    edits = EdsText(text)
    faults = FaultList()
    for (index, sub), number in values.items():
        variable = file.variable(index, sub)
        key = f"0x{index:04X}:{sub:02X}"
        if variable is None:
            faults.add(key, number, "an object of the file")
            continue
        try:
            encode(number, variable.data_type)
        except (ValueError, OverflowError):
            faults.add(key, number, f"a value of type {TYPES[variable.data_type].name}")
            continue
        spelled = _spell(number, variable.data_type)
        if variable.generated:
            edits.put_listed(f"{variable.section}Value", str(sub), spelled)
        else:
            edits.put(variable.section, "ParameterValue", spelled)
    if faults:
        raise EdsError(name, faults)
    if file_name:
        old = file.section("FileInfo")
        if old and old.get("FileName") and not old.get("LastEDS"):
            edits.put("FileInfo", "LastEDS", old.get("FileName"))
        edits.put("FileInfo", "FileName", file_name)
    if node_id:
        edits.put("DeviceComissioning", "NodeID", str(node_id))  # spelled so by CiA 306
    return edits.text()


def _spell(number: Number, data_type: int) -> str:
    """Return a value as CiA 306 spells it; reals as bits, which every reader understands."""
    if isinstance(number, bytes | bytearray):
        return bytes(number).hex().upper()
    if isinstance(number, str):
        return number
    if data_type in (REAL32, REAL64):
        return "0x" + encode(number, data_type)[::-1].hex().upper()
    return str(int(number))


def _variables(od: ObjectDictionary) -> list[ODVariable]:
    variables = []
    for index in sorted(od.indices):
        found = od.indices[index]
        if isinstance(found, ODRecord | ODArray):
            variables += [found.subindices[sub] for sub in sorted(found.subindices)]
        else:
            variables.append(found)
    return variables


def _differs(variable: ODVariable) -> bool:
    if variable.value is None or not variable.writable or variable.index in _NOT_DOWNLOADED:
        return False
    return variable.default is None or _bytes(variable, variable.value) != _bytes(variable, variable.default)


def _bytes(variable: ODVariable, value: Number) -> bytes:
    return encode(value, variable.data_type or 0)


def _write(variable: ODVariable) -> Write:
    value = variable.default if variable.value is None else variable.value
    return Write(variable.index, variable.subindex, _bytes(variable, 0 if value is None else value))


def _pdo_of(index: int) -> tuple[Direction, int] | None:
    for direction in Direction:
        for first in direction.value:
            if first <= index < first + cia.MAX_PDOS:
                return direction, index - first + 1
    return None


def _pdo_writes(od: ObjectDictionary, direction: Direction, number: int, *, is_whole: bool) -> list[Write]:
    """Return the downloads for one PDO: off, parameters, mapping emptied and filled, and its COB-ID last.

    Without ``is_whole`` parameters and mapping that are as at power-on are left out.
    """
    communication = od.indices[direction.communication + number - 1]
    mapping = od.indices.get(direction.mapping + number - 1)
    cob_id = communication.subindices[cia.PDO_COB_ID]
    final = _write(cob_id)
    # an identifier may not change while the PDO is valid: first the one it has at power-on, switched off
    off = (cob_id.default if isinstance(cob_id.default, int) else 0) | cia.COB_ID_INVALID
    plan = [Write(final.index, final.sub, off.to_bytes(4, "little"))]
    others = [v for sub, v in sorted(communication.subindices.items()) if sub not in (0, cia.PDO_COB_ID)]
    plan += [_write(v) for v in others if _differs(v) or (is_whole and v.writable)]
    if mapping is not None and (
        any(_differs(variable) for variable in mapping.subindices.values())
        or (is_whole and mapping.subindices[0].writable)
    ):
        count = _write(mapping.subindices[0])
        plan.append(Write(count.index, 0, b"\0"))
        plan += [_write(mapping.subindices[sub]) for sub in range(1, count.data[0] + 1)]
        plan.append(count)
    return [*plan, final]
