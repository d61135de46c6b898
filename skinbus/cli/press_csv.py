"""CSV files of others: presses at known places, and columns of numbers over time (poses, forces)."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.config.wording import header_faults, nearest
from skinbus.errors import ConfigError, Fault, FaultList
from skinbus.estimate.presses.kinds import Press
from skinbus.file_bytes import read_bytes
from skinbus.model import Arm
from skinbus.skin.addresses import bus_numbers

Floats = npt.NDArray[np.float64]

COUNTS, PASCALS = "c", "p"
"""First letter of the columns of readings: c1, c2, ... as they are on the wire, or p1, p2, ... in Pa.
Gains of the board are in neither: they change with each calibration from the same presses."""
NOISE: Final = "n"
"""First letter of the columns of noise, in the unit of the readings."""
MAX_BYTES: Final = 256 << 20
"""An hour of poses at 1 kHz."""
FEWEST: Final = 10
"""Lines of columns over time."""
MOST_READ: Final = 2.0**32
"""Counts have 32 bits at most, and 4 GPa is beyond any skin; what follows overflows nowhere."""
_ALWAYS: Final = ("node_id", "s_mm", "a_mm")
_FORCE: Final = "force_n"
_BESIDE: Final = frozenset(("", "t", "t_s", "time", "time_s", "line", "bus", "note", "comment"))
"""Names of columns, in small letters, that cannot be meant for one that is read."""
_WANTED: Final = "node_id, s_mm, a_mm, and c1, c2, ... or p1, p2, ...; force_n and n1, n2, ... if known"
_READ: Final = re.compile(rf"[{COUNTS}{PASCALS}{NOISE}][1-9]\d{{0,3}}")
"""Names of columns of readings and their noise."""


class PressFile(NamedTuple):
    """What a table of presses holds."""

    presses: list[Press]
    unread: list[str]
    """Columns that are not read, with what they may be meant for."""
    repeated: list[int]
    """Lines left out because one before them has the same place, force and readings."""


def read_presses(arm: Arm, path: Path, bus: str | None = None) -> PressFile:
    """Return the presses in a file; the zeros in rows without a touch (force 0) are subtracted.

    bus: of all rows; where node-IDs repeat from bus to bus, the column `bus` names that of each.

    Raises:
        AddressError: the arm has no such bus.
        ConfigError: faults of the file, all of them; keys are line and column.
    """
    only = bus_numbers(arm, [bus])[0] if bus else None
    names, rows = _read_table(path)
    kind = COUNTS if "c1" in names else PASCALS
    needed = [(*_ALWAYS, f"{letter}1") for letter in (COUNTS, PASCALS)]
    if wrong := header_faults(names, needed, _WANTED, [_FORCE]) or _gaps(names, kind) or _forceless(names):
        raise ConfigError(str(path), wrong)
    faults = FaultList()
    presses: list[Press] = []
    for line, row in rows:
        if len(row) > len(names):
            wanted = "a value for each column, points in numbers"
            faults.append(Fault(f"line {line}", "more values than columns", wanted))
        cells = dict(zip(names, row, strict=False))
        found = list(_faults_in(arm, cells, line, kind, only))
        faults.extend(fault for fault in found if fault.key != "column bus" or fault not in faults)
        if not found and len(row) <= len(names):
            presses.append(_press(arm, cells, line, kind, only))
    pressed = [press.force for press in presses if press.force != 0.0]
    unknown = sum(map(math.isnan, pressed))
    if 0 < unknown < len(pressed):
        seen = f"empty in {unknown} of {len(pressed)} presses"
        faults.append(Fault("force_n", seen, "all of them, or none if it is the same in all"))
    if not pressed and not faults:
        faults.append(Fault("file", None, "presses"))
    widest = max((press.patch for press in presses), key=lambda p: _n_tactels(arm, p), default=None)
    have = sum(bool(re.fullmatch(rf"{kind}[1-9]\d{{0,3}}", name)) for name in names)
    if widest is not None and have < (n := _n_tactels(arm, widest)):
        wanted = (
            f"columns to {kind}{n}: node {arm.node_label(widest)} has {n} tactels; "
            "a cell is empty where there is no reading"
        )
        faults.append(Fault("line 1", f"{kind}1 to {kind}{have}", wanted))
    if faults:
        raise ConfigError(str(path), faults)
    known = [name for name in (*_ALWAYS, _FORCE) if name not in names]
    unread = [f"{name!r}{nearest(name, known)}" for name in _unknown(names)]
    kept, repeated = _without_repeats(_without_zeros(presses))
    return PressFile(kept, unread, repeated)


def read_columns(
    path: Path, choices: Sequence[Sequence[str]], optional: Sequence[str] = ()
) -> dict[str, Floats]:
    """Return all columns of numbers, those of one of the choices among them, in order of ``t_s``.

    optional: columns that the caller reads if they are there

    Raises:
        ConfigError: the columns of no choice are there, or values are no numbers, all faults.
    """
    names, rows = _read_table(path)
    choice = next((c for c in choices if set(c) <= set(names)), None)
    wanted = " or ".join(", ".join(c) for c in choices)
    if wrong := header_faults(names, [choice] if choice else choices, "" if choice else wanted, optional):
        raise ConfigError(str(path), wrong)
    faults, numbers = FaultList(), []
    for line, row in rows:
        if len(row) != len(names):
            faults.append(Fault(f"line {line}", f"{len(row)} values", f"{len(names)} values, as in line 1"))
            continue
        numbers.append([_number(text) for text in row])
        for name in choice or ():
            if not math.isfinite(numbers[-1][names.index(name)]):
                faults.append(Fault(f"line {line}, {name}", row[names.index(name)] or None, "a number"))
    if not faults and len(numbers) < FEWEST:
        faults.append(Fault("file", f"{len(numbers)} lines", f"{FEWEST} at least"))
    if faults:
        raise ConfigError(str(path), faults)
    columns = dict(zip(names, np.array(numbers).T, strict=True))
    if not (np.diff(columns["t_s"]) > 0.0).all():
        fault = Fault("t_s", "times that do not grow", "each later than the one before")
        raise ConfigError(str(path), [fault])
    return columns


def _read_table(path: Path) -> tuple[list[str], Iterator[tuple[int, list[str]]]]:
    """Return the names of columns, and the rows with their line numbers, one after the other."""
    text = read_bytes(path, MAX_BYTES).decode("utf-8-sig", errors="replace")
    reader = csv.reader(io.StringIO(text, newline=""))

    def rows() -> Iterator[tuple[int, list[str]]]:
        try:
            for row in reader:
                if row:
                    yield reader.line_num, row
        except csv.Error as error:
            fault = Fault(f"line {reader.line_num}", None, f"a line of a table: {error}")
            raise ConfigError(str(path), [fault]) from None

    lines = rows()
    _, names = next(lines, (1, []))
    return [name.strip() for name in names], lines


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _n_tactels(arm: Arm, patch: int) -> int:
    return arm.patches[patch].patch.n_tactels


def _values(cells: dict[str, str], letter: str, n: int) -> Floats:
    """Return the columns letter1 ... lettern of a row, NaN where there is nothing."""
    return np.array([_number(cells.get(f"{letter}{k + 1}", "")) for k in range(n)])


def _faults_in(arm: Arm, cells: dict[str, str], line: int, kind: str, only: int | None) -> Iterator[Fault]:
    """Return what is wrong with a row."""
    key = f"line {line}"
    for name, text in cells.items():
        is_needed = name in _ALWAYS or bool(text.strip() and (name == _FORCE or _READ.fullmatch(name)))
        if is_needed and not math.isfinite(_number(text)):
            yield Fault(f"{key}, {name}", text.strip() or None, "a number")
    for name in _ALWAYS:
        if name not in cells:
            yield Fault(f"{key}, {name}", None, "a number")
    if (force := _number(cells.get(_FORCE, ""))) < 0.0:
        yield Fault(f"{key}, force_n", force, "a positive number; 0 where nothing touches; or nothing")
    if not math.isfinite(_number(cells.get("node_id", ""))):
        return
    patch = _patch_of(arm, cells, key, only)
    if isinstance(patch, Fault):
        yield patch
        return
    n = _n_tactels(arm, patch)
    readings, noise = _values(cells, kind, n), _values(cells, NOISE, n)
    if (noise < 0.0).any():
        yield Fault(f"{key}, {NOISE}1 ...", float(np.nanmin(noise)), "standard deviations")
    for name, column in ((kind, readings), (NOISE, noise)):
        if (np.abs(column) > MOST_READ).any():
            yield Fault(f"{key}, {name}1 ...", float(np.nanmax(np.abs(column))), f"at most {MOST_READ:g}")
    if all(not cells.get(f"{kind}{k + 1}", "").strip() for k in range(n)):
        yield Fault(key, "no reading", f"some of {kind}1 to {kind}{n}")


def _press(arm: Arm, cells: dict[str, str], line: int, kind: str, only: int | None) -> Press:
    """Return the press of a row without faults."""
    patch = _patch_of(arm, cells, "", only)
    assert isinstance(patch, int)
    here, n = arm.tactels_of(patch), _n_tactels(arm, patch)
    readings, noise = _values(cells, kind, n), _values(cells, NOISE, n)
    is_single = kind == COUNTS and bool((np.isnan(readings) | (readings == np.rint(readings))).all())
    scale = np.asarray(arm.tactel_gain[here])
    if kind == COUNTS:
        readings = readings - arm.tactel_offset[here]
        scale = arm.patches[patch].patch.transducer.step * scale
    s, a, force = (_number(cells.get(name, "")) for name in ("s_mm", "a_mm", _FORCE))
    return Press(patch, 1e-3 * s, 1e-3 * a, force, readings * scale, line, noise * scale, is_single)


def _patch_of(arm: Arm, cells: dict[str, str], line: str, only: int | None) -> int | Fault:
    """Return the patch of a row, or why none is meant."""
    node_id = _number(cells["node_id"])
    found = arm.patches_named(int(node_id)) if node_id == int(node_id) else []
    if not found:
        return Fault(f"{line}, node_id", f"{node_id:g}", "a patch of the arm")
    bus, names = only, [settings.name for settings in arm.buses]
    known, key = " or ".join(names), f"{line}, bus"
    if "bus" in cells and len(names) > 1:
        name = cells["bus"].strip()
        if name not in names or (bus is not None and name != names[bus]):
            wanted = f"{names[bus]}, as --bus says" if bus is not None and name in names else known
            return Fault(key, name or None, wanted)
        bus = names.index(name)
    if bus is not None:
        own = names[arm.patch_bus[found[0]]]
        found = [p for p in found if arm.patch_bus[p] == bus]
        if not found:
            return Fault(key, names[bus], f"{own}, which has node {node_id:g}")
    if len(found) > 1:
        return Fault("column bus", None, f"it, or --bus, as node-IDs repeat: {known}")
    return found[0]


def _unknown(names: list[str]) -> list[str]:
    """Return the names of columns that are neither read nor known to stand beside what is read."""
    rest = [name for name in names if name not in (*_ALWAYS, _FORCE) and not _READ.fullmatch(name)]
    return [name for name in rest if name.lower() not in _BESIDE]


def _forceless(names: list[str]) -> list[Fault]:
    """Return the columns that may hold the forces of a file that has none."""
    if _FORCE in names:
        return []
    wanted = (
        f"{_FORCE!r} if these are forces in N; else a column {_FORCE!r} beside it, empty: forces not known"
    )
    return [Fault("line 1", name, wanted) for name in _unknown(names)]


def _gaps(names: list[str], kind: str) -> list[Fault]:
    """Return the columns of readings, and of noise, that are left out between others."""
    faults = []
    for letter in (kind, NOISE):
        have = {int(name[1:]) for name in names if re.fullmatch(rf"{letter}[1-9]\d{{0,3}}", name)}
        missing = sorted({*range(1, max(have, default=0))} - have)
        if missing:
            of = ", ".join(f"{letter}{k}" for k in missing[:10]) + (", ..." if len(missing) > 10 else "")
            seen = f"{letter}1 to {letter}{max(have)} without {of}"
            faults.append(Fault("line 1", seen, "all of them; a cell is empty where there is no reading"))
    return faults


def _without_zeros(presses: list[Press]) -> list[Press]:
    """Return the rows of touches, with what the tactels read without any taken off."""
    quiet: dict[int, list[Floats]] = {}
    for press in presses:
        if press.force == 0.0:
            quiet.setdefault(press.patch, []).append(press.readings)
    for patch, rows in quiet.items():
        n_read = np.isfinite(rows).sum(axis=0)
        zero = np.nansum(rows, axis=0) / np.maximum(n_read, 1)
        for press in presses:
            if press.patch == patch:
                press.readings[:] -= zero
    return [press for press in presses if press.force != 0.0]


def _without_repeats(presses: list[Press]) -> tuple[list[Press], list[int]]:
    """Return the presses that differ, and the lines of the others: no error can be measured with those."""
    seen: set[tuple[object, ...]] = set()
    kept, repeated = [], []
    for press in presses:
        # as bytes, in which a missing reading equals another one
        what = (press.patch, press.s, press.a, str(press.force), press.readings.tobytes())
        if what in seen:
            repeated.append(press.line)
        else:
            seen.add(what)
            kept.append(press)
    return kept, repeated


def reading_columns(n: int) -> list[str]:
    """Return the names of the columns of readings in Pa, and of their noise, of n tactels at most."""
    return [f"{letter}{k + 1}" for letter in (PASCALS, NOISE) for k in range(n)]


def reading_cells(readings: Floats, noise: Floats | None, gain: Floats, n: int) -> list[str]:
    """Return what stands in these columns for the readings (n_tactels,) Pa of a patch with these gains."""
    cells: list[str] = []
    for values in (readings, np.full_like(readings, np.nan) if noise is None else noise):
        values = values / gain
        cells += ["" if np.isnan(x) else f"{x:.2f}" for x in values] + [""] * (n - len(values))
    return cells
