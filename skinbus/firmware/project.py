"""The C project of one board: core and ports as they are, and the object dictionary of its EDS as tables.

Values lie in one image without gaps, in the order of index and sub-index, little-endian as on the wire; a
text has its length before it, and texts that can be written come last. Consecutive sub-indices that are
alike but for their value are one run of the table.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from canopen.objectdictionary import datatypes

from skinbus.errors import EdsError, Fault
from skinbus.node.layout import FLOATS, ImageEntry, ImageLayout
from skinbus.node.storage import APPLICATION, AREAS, COMMUNICATION, MANUFACTURER, is_parameter
from skinbus.objects import cia
from skinbus.objects.dcf import is_verified
from skinbus.objects.eds import load_eds
from skinbus.objects.guard import GuardLimits
from skinbus.objects.pdo import Direction, pdo_numbers
from skinbus.objects.profile import (
    COMMUNICATION_CHECKSUM,
    GUARD_LIMITS,
    GUARD_PERIOD_US,
    GUARD_STATE,
    HEALTHY_TACTELS,
    SAMPLE_COUNTER,
    has,
    index_of,
    number_at,
)

NODE_ID = 1
"""Node-ID at which the dictionary is read; what depends on it is stored without it."""
NO_VALUE = b"\xff\xff"
"""In place of the length of a text."""
GROUPS = COMMUNICATION, APPLICATION, MANUFACTURER
"""Of parameters that are stored, in the order of their bits in the core."""
LIMITED = 4
"""Bytes of the largest value with limits."""
PERIOD_US = 1000
"""From one look at the readings, for events, to the next where a board has no guard."""
PER_LINE = 16
HERE = Path(__file__).parent
RELAY = HERE / "core/relay.c"
"""Of the core: all that a stop relay has, and no board."""
SIZES = (
    *("N_RUNS", "DEFAULTS", "IMAGE", "N_LIMITS", "N_TACTELS", "READING_BYTES", "N_PDOS"),
    *("PDO_ENTRIES", "CONSUMED_ROOM", "GUARD_ROOM"),
)
"""Of a board, which a relay does not have; C has no empty arrays."""


class Run(NamedTuple):
    """Consecutive sub-indices of one object that are alike."""

    entries: Sequence[ImageEntry]
    at: str
    """Offset in the image; that of a text depends on the room of those before it."""


def write_project(eds: str, out: Path) -> tuple[int, int]:
    """Write the project of the board that an EDS describes; return bytes of its image and entries.

    Raises:
        EdsError: the EDS is faulty, or asks for what the core does not have.
    """
    layout = ImageLayout(load_eds(eds, NODE_ID), NODE_ID)
    _write(out, *_texts(eds, layout), [path for path in HERE.glob("core/*") if path != RELAY])
    return sum(entry.size for entry in layout.entries.values()), len(layout.entries)


def write_relay(arm: str, cob_ids: Sequence[int], silent_us: int, out: Path) -> None:
    """Write the project of a stop relay.

    Args:
        arm: name of the file, for the comment.
        cob_ids: identifiers of the states of the guards of all guarded patches on its bus.
        silent_us: a patch that says nothing for longer is a stop.
        out: folder of the project.
    """
    source = _source(arm)
    values = dict.fromkeys(SIZES, 1) | {"FRAME_BYTES": 8, "N_GUARDED": len(cob_ids), "SILENT_US": silent_us}
    table = _table("uint16_t sb_guarded[SB_N_GUARDED]", [f"0x{cob_id:03X}" for cob_id in cob_ids])
    tables = f'{source}#include "skin.h"\n\n{table}'
    _write(out, _header(source, values), tables, [HERE / "core/skin.h", RELAY])


def _write(out: Path, header: str, tables: str, core: Iterable[Path]) -> None:
    """Write files of the core, all ports and what was made."""
    for source in (*core, *HERE.glob("ports/*"), HERE / "Makefile"):
        target = out / source.relative_to(HERE)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(source.read_bytes())
    (out / "board.h").write_text(header)
    (out / "board.c").write_text(tables)


def _source(name: str) -> str:
    return f"/* Made from {Path(name).name} by `skinbus board firmware`. */\n"


def _header(source: str, defines: Mapping[str, int | str]) -> str:
    """Return the text of the header; numbers are unsigned."""
    values = {name: value if isinstance(value, str) else f"{value}u" for name, value in defines.items()}
    lines = [f"#ifndef SB_{name}\n#define SB_{name} {value}\n#endif" for name, value in values.items()]
    return "\n".join([f"{source}#ifndef BOARD_H\n#define BOARD_H\n", *lines, "\n#endif\n"])


def _kind(entry: ImageEntry) -> tuple[object, ...]:
    """Return what entries of one run share; a text and what is relative to the node-ID is alone."""
    alone = entry.sub if entry.relative or not entry.size else None
    return entry.index, entry.size, _access(entry), entry.variable.min, entry.variable.max, alone


def _room(entry: ImageEntry) -> str:
    """Return the most bytes of a text that can be written, which has no default; nothing for all else."""
    if entry.size or not entry.writable:
        return ""
    if entry.index == cia.PROGRAM_DATA:
        return "SB_PROGRAM_ROOM"
    return "SB_GUARD_ROOM" if entry.variable.name == GUARD_LIMITS else "SB_TEXT_ROOM"


def _bytes(entry: ImageEntry) -> bytes:
    """Return the default of an entry as it lies in the image."""
    if entry.size:
        return (entry.default or b"").ljust(entry.size, b"\0")
    return NO_VALUE if entry.default is None else len(entry.default).to_bytes(2, "little") + entry.default


def _runs(entries: Iterable[ImageEntry]) -> tuple[list[Run], str]:
    """Return all entries as runs, with their places, and the size of the image."""
    ordered = sorted(entries, key=lambda entry: (entry.index, entry.sub))
    steps = [entry.sub - i for i, entry in enumerate(ordered)]  # the same while sub-indices follow each other
    runs, at, end = [], 0, "SB_DEFAULTS"
    for _, group in groupby(zip(ordered, steps, strict=True), lambda item: (_kind(item[0]), item[1])):
        part = [entry for entry, _ in group]
        if _room(part[0]):
            runs.append(Run(part, end))
            is_program = part[0].index == cia.PROGRAM_DATA  # which has slots of its own
            end += " + 2" if is_program else f" + 2 + {_room(part[0])}"
        else:
            runs.append(Run(part, str(at)))
            at += sum(len(_bytes(entry)) for entry in part)
    return runs, f"({end})"


def _texts(eds: str, layout: ImageLayout) -> tuple[str, str]:
    """Return the text of the header and that of the tables."""
    runs, n_bytes = _runs(layout.entries.values())
    image = b"".join(_bytes(entry) for run in runs for entry in run.entries if not _room(entry))
    limits = list(dict.fromkeys(_limit(run.entries[0]) for run in runs))
    pdos = {way: pdo_numbers(layout.od, way) for way in (Direction.RPDO, Direction.TPDO)}
    defines: dict[str, int | str] = {
        "N_RUNS": len(runs),
        "DEFAULTS": len(image),
        "IMAGE": n_bytes,
        "N_LIMITS": len(limits),
        "TEXT_ROOM": 2048,  # for each text that can be written
        "PROGRAM_BYTES": 0,  # no program download
        **_services(eds, layout, runs, pdos),
    }
    tables = [
        _table("struct sb_run sb_runs[SB_N_RUNS]", [_run(run, limits) for run in runs]),
        _table("uint8_t sb_defaults[SB_DEFAULTS]", [str(byte) for byte in image]),
        _table("int64_t sb_limits[SB_N_LIMITS][2]", limits),
        _table("uint16_t sb_pdos[SB_N_PDOS]", [hex(w.communication + n - 1) for w in pdos for n in pdos[w]]),
    ]
    defines["DICTIONARY"] = zlib.crc32("".join(tables).encode())
    source = _source(eds)
    return _header(source, defines), "\n".join([f'{source}#include "skin.h"\n', *tables])


def _services(
    eds: str, layout: ImageLayout, runs: Sequence[Run], pdos: dict[Direction, list[int]]
) -> dict[str, int]:
    """Return what the services of the board are made for; a room is at least 1, as C has no empty arrays."""
    od = layout.od
    readings = next(
        (run for run in runs if run.entries[0].index in cia.READINGS and run.entries[0].sub), None
    )
    if readings is None:
        raise EdsError(eds, [Fault("readings", None, "0x6401 or 0x6400")])
    mapped = [len(layout.subs(way.mapping + n - 1)) for way, numbers in pdos.items() for n in numbers]
    rates = od.device_information.allowed_baudrates
    names = (SAMPLE_COUNTER, COMMUNICATION_CHECKSUM, GUARD_STATE, GUARD_LIMITS, HEALTHY_TACTELS)
    stamp, checksum, *guard = (index_of(od, name)[0] if has(od, name) else 0 for name in names)
    state, limits, healthy = guard if all(guard) else (0, 0, 0)
    period = number_at(od, *index_of(od, GUARD_PERIOD_US)) if state else PERIOD_US
    return {
        "VENDOR": number_at(od, cia.IDENTITY, cia.IDENTITY_VENDOR),
        "PRODUCT": number_at(od, cia.IDENTITY, cia.IDENTITY_PRODUCT),
        "N_TACTELS": len(readings.entries),
        "READINGS": readings.entries[0].index,
        "READINGS_AT": int(readings.at),
        "READING_BYTES": readings.entries[0].size,
        "STAMP": stamp,
        "CHECKSUM": checksum,
        "GUARD": state,
        "GUARD_LIMITS": limits,
        "GUARD_ROOM": GuardLimits.size(len(readings.entries)),
        "HEALTHY": healthy,
        "PERIOD_US": period,
        "N_RPDOS": len(pdos[Direction.RPDO]),
        "N_PDOS": len(mapped),
        "PDO_ENTRIES": max(mapped, default=1),
        "CONSUMED_ROOM": max(len(layout.subs(cia.HEARTBEAT_CONSUMER)), 1),
        "FRAME_BYTES": layout.max_pdo_bits // 8,
        "LSS": int(bool(od.device_information.LSS_supported)),
        "BIT_RATES": sum(1 << bit for bit, rate in cia.BIT_RATES.items() if rate in rates),
    }


def _table(head: str, items: Sequence[str]) -> str:
    rows = [", ".join(items[i : i + PER_LINE]) for i in range(0, len(items), PER_LINE)]
    return f"const {head} = {{\n    " + ",\n    ".join(rows) + "\n};\n"


def _limit(entry: ImageEntry) -> str:
    """Return the limits that the core keeps: of integers of up to 32 bits, and of the length of a text."""
    if room := _room(entry):
        return f"{{0, {room}}}"
    has_limits = 0 < entry.size <= LIMITED and entry.variable.data_type not in FLOATS
    low, high = (entry.variable.min, entry.variable.max) if has_limits else (None, None)
    begin = "INT64_MIN" if low is None else f"{int(low)}LL"
    return f"{{{begin}, {'INT64_MAX' if high is None else f'{int(high)}LL'}}}"


def _access(entry: ImageEntry) -> int:
    """Return the bits of a run, in the order that the core has."""
    kind = entry.variable.data_type
    bits = (
        *(entry.readable, entry.writable, entry.mappable_tx, entry.mappable_rx, entry.relative),
        *(kind in datatypes.SIGNED_TYPES, kind == datatypes.BOOLEAN, kind in FLOATS),
        is_parameter(entry) and is_verified(entry.index),
        *(is_parameter(entry) and entry.index in AREAS[group] for group in GROUPS),
    )
    return sum(1 << k for k, has in enumerate(bits) if has)


def _run(run: Run, limits: list[str]) -> str:
    entry = run.entries[0]
    head = f"0x{entry.index:04X}, {entry.sub}, {len(run.entries)}, {entry.size}"
    return f"{{{head}, {limits.index(_limit(entry))}, {_access(entry)}, {run.at}}}"
