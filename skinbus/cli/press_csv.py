"""CSV files of others: presses at known places, and columns of numbers over time (poses, forces)."""

from __future__ import annotations

import csv
import io
import math
import os
import re
from collections.abc import Sequence
from itertools import repeat
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.config.wording import header_faults
from skinbus.errors import ConfigError, Fault, FaultList
from skinbus.estimate.calibration.table import Press
from skinbus.file_bytes import read_bytes
from skinbus.model import Arm

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
_READ: Final = re.compile(rf"{_FORCE}|[{COUNTS}{PASCALS}{NOISE}][1-9]\d{{0,3}}")
"""Names of columns that are read where they are there."""


class PressFile(NamedTuple):
    """What a table of presses holds."""

    presses: list[Press]
    unread: list[str]
    """Columns that are not read."""


def read_presses(arm: Arm, path: Path) -> PressFile:
    """Return the presses in a file; the zeros in rows without a touch (force 0) are subtracted.

    Raises:
        ConfigError: faults of the file, all of them; keys are line and column.
    """
    needed = [(*_ALWAYS, f"{letter}1") for letter in (COUNTS, PASCALS)]
    names, rows, faults = _read_table(path, needed, _WANTED, [_FORCE], _READ)
    presses: list[Press] = []
    for row in rows:
        found = _press(arm, row)
        if isinstance(found, Press):
            presses.append(found)
        else:
            faults.append(found)
    forces = np.array([press.force for press in presses if press.force != 0.0])
    if 0 < (unknown := int(np.isnan(forces).sum())) < len(forces):
        seen = f"empty in {unknown} of {len(forces)} presses"
        faults.append(Fault(_FORCE, seen, "all of them, or none if it is the same in all"))
    if not len(forces) and not faults:
        faults.append(Fault("file", None, "presses"))
    if faults:
        raise ConfigError(str(path), faults)
    rest = [
        name for name in names if not (name in _ALWAYS or _READ.fullmatch(name) or name.lower() in _BESIDE)
    ]
    return PressFile(_without_zeros(presses), rest)


def read_columns(
    path: Path, choices: Sequence[Sequence[str]], optional: Sequence[str] = ()
) -> dict[str, Floats]:
    """Return all columns of numbers, those of one of the choices among them, in order of ``t_s``.

    optional: columns that the caller reads if they are there

    Raises:
        ConfigError: the columns of no choice are there, or values are no numbers, all faults.
    """
    names, rows, faults = _read_table(path, choices, " or ".join(map(", ".join, choices)), optional)
    if not faults and len(rows) < FEWEST:
        faults.append(Fault("file", f"{len(rows)} lines", f"{FEWEST} at least"))
    columns = {name: np.array([row.numbers[name] for row in rows]) for name in names}
    if not faults and not (np.diff(columns["t_s"]) > 0.0).all():
        faults.append(Fault("t_s", "times that do not grow", "each later than the one before"))
    if faults:
        raise ConfigError(str(path), faults)
    return columns


def columns_of(arm: Arm) -> list[str]:
    """Return the columns of a table of presses on an arm."""
    numbers = range(1, 1 + max(placed.patch.n_tactels for placed in arm.patches))
    readings = [f"{letter}{k}" for letter in (PASCALS, NOISE) for k in numbers]
    return ["bus", "t_s", *_ALWAYS, _FORCE, *readings]


def write_presses(path: Path, arm: Arm, presses: Sequence[Press], times: Sequence[float] = ()) -> None:
    """Write a table of presses whole: a loss of power leaves the file as it was.

    times: of the presses in their recording, s
    """
    text = io.StringIO(newline="")
    table = csv.writer(text)
    table.writerow(columns_of(arm))
    widest = max(placed.patch.n_tactels for placed in arm.patches)
    for press, t in zip(presses, times or repeat(math.nan), strict=False):
        placed = arm.patches[press.patch]
        cells, n = np.full((2, widest), math.nan), len(press.readings)
        cells[0, :n] = press.readings
        cells[1, :n] = math.nan if press.noise is None else press.noise
        cells[:, :n] /= arm.tactel_gain[arm.tactels_of(press.patch)]
        numbers = [t, placed.node_id, 1e3 * press.s, 1e3 * press.a, press.force, *cells.ravel()]
        shown = ("" if math.isnan(number) else f"{number:.6g}" for number in numbers)
        table.writerow([arm.buses[placed.bus].name, *shown])
    beside = path.with_name(f"{path.name}.new")
    beside.write_text(text.getvalue(), encoding="utf-8", newline="")
    os.replace(beside, path)


class _Row(NamedTuple):
    """A row: its line, its numbers by column (NaN for a cell without one), and the name of a bus."""

    line: int
    numbers: dict[str, float]
    bus: str | None

    def values(self, letter: str, n: int) -> Floats:
        """Return the columns letter1 ... lettern."""
        return np.array([self.numbers.get(f"{letter}{k + 1}", math.nan) for k in range(n)])


def _read_table(
    path: Path,
    choices: Sequence[Sequence[str]],
    wanted: str,
    optional: Sequence[str],
    read: re.Pattern[str] = re.compile("(?!)"),
) -> tuple[list[str], list[_Row], FaultList]:
    """Return the names of columns, the rows without fault, and the faults of the others.

    Cells are numbers in the columns of one of the choices, and with any text in a column that is ``read``.
    """
    text = read_bytes(path, MAX_BYTES).decode("utf-8-sig", errors="replace")
    reader = csv.reader(io.StringIO(text, newline=""))
    rows, faults = [], FaultList()
    try:
        names = [name.strip() for name in next(filter(None, reader), [])]
        if wrong := header_faults(names, choices, wanted, optional):
            raise ConfigError(str(path), wrong)
        needed = next(choice for choice in choices if set(choice) <= set(names))
        for row in filter(None, reader):
            cells = dict(zip(names, map(str.strip, row), strict=False))
            numbers = {name: _number(cell) for name, cell in cells.items()}
            wrong = [
                Fault(f"line {reader.line_num}, {name}", cell or None, f"a number, at most {MOST_READ:g}")
                for name, cell in cells.items()
                if (cell if read.fullmatch(name) else name in needed) and not abs(numbers[name]) <= MOST_READ
            ]
            if len(row) != len(names):
                seen = f"{len(row)} values"
                wrong.append(Fault(f"line {reader.line_num}", seen, f"{len(names)} values, as in line 1"))
            if not wrong:
                rows.append(_Row(reader.line_num, numbers, cells.get("bus")))
            faults += wrong
    except csv.Error as error:
        fault = Fault(f"line {reader.line_num}", None, f"a line of a table: {error}")
        raise ConfigError(str(path), [fault]) from None
    return names, rows, faults


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _press(arm: Arm, row: _Row) -> Press | Fault:
    """Return the press of a row, or what is wrong with it."""
    patch, key = _patch_of(arm, row), f"line {row.line}"
    if isinstance(patch, Fault):
        return patch
    here, n = arm.tactels_of(patch), arm.patches[patch].patch.n_tactels
    kind = COUNTS if "c1" in row.numbers else PASCALS
    readings, noise = row.values(kind, n), row.values(NOISE, n)
    force = row.numbers.get(_FORCE, math.nan)
    if force < 0.0:
        return Fault(f"{key}, {_FORCE}", force, "a positive number; 0 where nothing touches; or nothing")
    if (noise < 0.0).any():
        return Fault(f"{key}, {NOISE}1 ...", float(np.nanmin(noise)), "standard deviations")
    if np.isnan(readings).all():
        return Fault(key, "no reading", f"some of {kind}1 to {kind}{n}")
    scale, is_single = np.asarray(arm.tactel_gain[here]), False
    if kind == COUNTS:
        is_single = bool((np.isnan(readings) | (readings == np.rint(readings))).all())
        readings = readings - arm.tactel_offset[here]
        scale = arm.patches[patch].patch.transducer.step * scale
    s, a = 1e-3 * row.numbers["s_mm"], 1e-3 * row.numbers["a_mm"]
    return Press(patch, s, a, force, readings * scale, row.line, noise * scale, is_single)


def _patch_of(arm: Arm, row: _Row) -> int | Fault:
    """Return the patch of a row, or that none, or several, may be meant."""
    node_id, buses = row.numbers["node_id"], [settings.name for settings in arm.buses]
    found = [
        p
        for p in np.flatnonzero(arm.node_id == node_id).tolist()
        if len(buses) == 1 or not row.bus or buses[arm.patch_bus[p]] == row.bus
    ]
    if len(found) == 1:
        return int(found[0])
    seen = f"{node_id:g}{f' of bus {row.bus}' if row.bus else ''}"
    names = f"; a column bus with {' or '.join(buses)}, where node-IDs repeat" if len(buses) > 1 else ""
    return Fault(f"line {row.line}, node_id", seen, f"a patch of the arm{names}")


def _without_zeros(presses: list[Press]) -> list[Press]:
    """Return the rows of touches, with what the tactels read without any taken off."""
    for patch in {press.patch for press in presses if press.force == 0.0}:
        own = [press for press in presses if press.patch == patch]
        quiet = np.array([press.readings for press in own if press.force == 0.0])
        zero = np.nansum(quiet, axis=0) / np.maximum(np.isfinite(quiet).sum(axis=0), 1)
        for press in own:
            press.readings[:] -= zero
    return [press for press in presses if press.force != 0.0]
