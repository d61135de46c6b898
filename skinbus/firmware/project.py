"""The C project of one board: core and ports as they are, and the object dictionary of its EDS as tables.

Values of fixed size lie in one image without gaps, in the order of index and sub-index, little-endian as on
the wire. Consecutive sub-indices that are alike but for their value are one run of the table.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Final, NamedTuple

from canopen.objectdictionary import ObjectDictionary

from skinbus.errors import EdsError, Fault
from skinbus.node.layout import ImageEntry, ImageLayout, key_of
from skinbus.objects import cia
from skinbus.objects.eds import load_eds
from skinbus.objects.eds_values import REAL32, REAL64
from skinbus.objects.pdo import Direction, pdo_numbers
from skinbus.objects.profile import COMMUNICATION_CHECKSUM, SAMPLE_COUNTER, index_of

NODE_ID: Final = 1
"""Node-ID at which the dictionary is read; what depends on it is stored without it."""
NOWHERE: Final = 0xFFFF
"""``SB_NOWHERE``: no such object, no value."""
AGE_SUB: Final = 3
"""Sub-index of the age beside the stamp of a sample."""
PER_LINE: Final = 16


class Run(NamedTuple):
    """Consecutive sub-indices of one object that are alike."""

    entries: Sequence[ImageEntry]
    at: int
    """Offset in the image; of a text, which is alone, its number."""


def write_project(eds: str, out: Path) -> tuple[int, int]:
    """Write the project of the board that an EDS describes; return bytes of its image and entries.

    Raises:
        EdsError: the EDS is faulty, or asks for what the core does not have.
    """
    od = load_eds(eds, NODE_ID)
    layout = ImageLayout(od, NODE_ID)
    header, tables = _texts(eds, od, layout)
    here = Path(__file__).parent
    for source in sorted([*here.glob("core/*"), *here.glob("ports/**/*"), here / "Makefile"]):
        if source.is_file():
            target = out / source.relative_to(here)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(source.read_bytes())
    (out / "board.h").write_text(header)
    (out / "board.c").write_text(tables)
    return sum(entry.size for entry in layout.entries.values()), len(layout.entries)


def _kind(entry: ImageEntry) -> tuple[object, ...]:
    """Return what entries of one run share; a text and what is relative to the node-ID is alone."""
    alone = entry.sub if entry.relative or not entry.size else None
    rights = entry.readable, entry.writable, entry.mappable_tx, entry.mappable_rx
    return entry.index, entry.variable.data_type, rights, entry.low, entry.high, alone


def _runs(entries: Iterable[ImageEntry]) -> list[Run]:
    """Return all entries as runs, with their places."""
    runs, at, n_texts = [], 0, 0
    ordered = sorted(entries, key=lambda entry: (entry.index, entry.sub))
    steps = [entry.sub - i for i, entry in enumerate(ordered)]  # the same while sub-indices follow each other
    for _, group in groupby(zip(ordered, steps, strict=True), lambda item: (_kind(item[0]), item[1])):
        part = [entry for entry, _ in group]
        if part[0].size:
            runs.append(Run(part, at))
            at += sum(entry.size for entry in part)
        else:
            runs.append(Run(part, n_texts))
            n_texts += 1
    return runs


def _texts(eds: str, od: ObjectDictionary, layout: ImageLayout) -> tuple[str, str]:
    """Return the text of the header and that of the tables."""
    runs = _runs(layout.entries.values())
    sized = [run for run in runs if run.entries[0].size]
    texts = [run.entries[0] for run in runs if not run.entries[0].size]
    image = b"".join((e.default or b"").ljust(e.size, b"\0") for run in sized for e in run.entries)
    writable = [entry for entry in texts if entry.writable]
    limits = {limit: None for run in sized if (limit := _limits(run.entries[0])) != (None, None)}
    numbers = {limit: number for number, limit in enumerate(limits, 1)}
    pdos = {direction: pdo_numbers(od, direction) for direction in Direction}
    defines = {
        "N_RUNS": len(runs),
        "IMAGE": len(image),
        "N_LIMITS": len(limits) + 1,
        "N_TEXTS": max(len(texts), 1),
        "TEXT_SLOTS": len(writable),
        **_places(eds, od, layout, sized),
        **_services(od, layout, pdos),
    }
    source = f"/* Made from {Path(eds).name} by `skinbus board firmware`. */\n"
    lines = [f"#define SB_{name} {value}u" for name, value in defines.items()]
    header = [f"{source}#ifndef BOARD_H\n#define BOARD_H\n", *lines, "\n#endif\n"]
    tables = [
        f'{source}#include "skin.h"\n',
        _table("struct sb_run sb_runs[SB_N_RUNS]", [_run(run, numbers) for run in runs]),
        _table("uint8_t sb_defaults[SB_IMAGE]", [str(byte) for byte in image]),
        _table("struct sb_limit sb_limits[SB_N_LIMITS]", ["{0, 0}", *map(_limit, limits)]),
        _table("struct sb_text sb_texts[SB_N_TEXTS]", [_text(e, writable) for e in texts] or ["{0, 0, 0}"]),
        _table("uint16_t sb_tpdos[SB_TPDO_ROOM]", [str(n - 1) for n in pdos[Direction.TPDO]] or ["0"]),
        _table("uint16_t sb_rpdos[SB_RPDO_ROOM]", [str(n - 1) for n in pdos[Direction.RPDO]] or ["0"]),
    ]
    return "\n".join(header), "\n".join(tables)


def _places(eds: str, od: ObjectDictionary, layout: ImageLayout, sized: Sequence[Run]) -> dict[str, int]:
    """Return where readings and their stamps lie."""
    places = {(e.index, e.sub): run.at + i * e.size for run in sized for i, e in enumerate(run.entries)}
    index = next((i for i in cia.READINGS if (i, 1) in places), 0)
    if not index:
        raise EdsError(eds, [Fault("readings", None, "0x6401 or 0x6400")])
    stamp, _ = index_of(od, SAMPLE_COUNTER) if SAMPLE_COUNTER.object in od.names else (0, 0)
    return {
        "N_TACTELS": len(layout.subs(index)),
        "READINGS": index,
        "READINGS_AT": places[index, 1],
        "READING_BYTES": layout.entries[key_of(index, 1)].size,
        "STAMP_AT": places.get((stamp, 1), NOWHERE),
        "AGE_AT": places.get((stamp, AGE_SUB), NOWHERE),
    }


def _services(od: ObjectDictionary, layout: ImageLayout, pdos: dict[Direction, list[int]]) -> dict[str, int]:
    """Return what the services of the board are made for; a room is at least 1, as C has no empty arrays."""
    checksum = od.names.get(COMMUNICATION_CHECKSUM.object)
    mapped = [len(layout.subs(way.mapping + n - 1)) for way, numbers in pdos.items() for n in numbers]
    rates = [bit for bit, rate in cia.BIT_RATES.items() if rate in od.device_information.allowed_baudrates]
    counts = {
        "TPDO": len(pdos[Direction.TPDO]),
        "RPDO": len(pdos[Direction.RPDO]),
        "CONSUMED": len(layout.subs(cia.HEARTBEAT_CONSUMER)),
    }
    return {
        "FRAME_BYTES": layout.max_pdo_bits // 8,
        "CHECKSUM": 0 if checksum is None else checksum.index,
        "PDO_ENTRIES": max(mapped, default=1),
        "GUARDING": int(cia.GUARD_TIME in layout.indices),
        "LSS": int(bool(od.device_information.LSS_supported)),
        "BIT_RATES": sum(1 << bit for bit in rates),
        **{f"{name}_ROOM": max(n, 1) for name, n in counts.items()},
    }


def _table(head: str, items: Sequence[str]) -> str:
    rows = [", ".join(items[i : i + PER_LINE]) for i in range(0, len(items), PER_LINE)]
    return f"const {head} = {{\n    " + ",\n    ".join(rows) + "\n};\n"


def _limits(entry: ImageEntry) -> tuple[float | None, float | None]:
    """Return the limits that the core keeps; it keeps none of reals."""
    return (None, None) if entry.variable.data_type in (REAL32, REAL64) else (entry.low, entry.high)


def _limit(limits: tuple[float | None, float | None]) -> str:
    low, high = limits
    begin = "INT64_MIN" if low is None else f"{int(low)}LL"
    return f"{{{begin}, {'INT64_MAX' if high is None else f'{int(high)}LL'}}}"


def _run(run: Run, limits: dict[tuple[float | None, float | None], int]) -> str:
    entry = run.entries[0]
    bits = (entry.readable, entry.writable, entry.mappable_tx, entry.mappable_rx, entry.relative)
    access = sum(1 << k for k, has in enumerate(bits) if has)
    limit = limits.get(_limits(entry), 0)
    head = f"0x{entry.index:04X}, {entry.sub}, {len(run.entries)}, {entry.variable.data_type}"
    return f"{{{head}, {access}, {limit}, {run.at}}}"


def _text(entry: ImageEntry, slots: Sequence[ImageEntry]) -> str:
    slot = slots.index(entry) + 1 if entry in slots else 0
    if entry.default is None:
        return f"{{NULL, SB_NOWHERE, {slot}}}"
    letters = "".join(f"\\{byte:03o}" for byte in entry.default)
    return f'{{"{letters}", {len(entry.default)}, {slot}}}'
