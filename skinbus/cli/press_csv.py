"""CSV files of others: presses at known places, and columns of numbers over time (poses, forces)."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skinbus.arrays import Floats
from skinbus.cli.output import whole_file
from skinbus.config.wording import header_faults
from skinbus.errors import ConfigError, Fault, FaultList
from skinbus.estimate.calibration.table import Press, mean_and_noise
from skinbus.file_bytes import read_bytes
from skinbus.model import Arm

MAX_BYTES = 256 << 20
"""An hour of poses at 1 kHz."""
FEWEST = 10
"""Lines of columns over time."""
MOST = 2.0**32
"""4 GPa is beyond any skin; what follows overflows nowhere."""
PRESSES = ("node_id", "s_mm", "a_mm", "p1")
"""Readings are p1, p2, ... in Pa; gains of the board are not in them: they change with each calibration from
the same presses."""
OPTIONAL = re.compile(r"force_n|[pn][1-9]\d{0,3}")
"""Columns that are read where they are there; n1, n2, ... are noise in Pa."""


class Row(NamedTuple):
    """A line of a file."""

    line: int
    numbers: dict[str, float]
    """By column; NaN for a cell that is none."""
    bus: str


def read_presses(arm: Arm, path: Path) -> list[Press]:
    """Return the presses in a file, less the zeros in rows without a touch (force 0).

    Raises:
        ConfigError: faults of the file, all of them; keys are line and column.
    """
    _, rows, faults = _read(path, [PRESSES], ["force_n"])
    buses = [bus.name for bus in arm.buses]
    which = f"; a column bus with {' or '.join(buses)}, where node-IDs repeat" if len(buses) > 1 else ""
    presses: list[Press] = []
    for line, row, bus in rows:
        is_own = arm.node_id == row["node_id"]
        if which and bus:
            is_own &= np.array(buses)[arm.patch_bus] == bus
        if is_own.sum() != 1:
            seen = f"{row['node_id']:g}" + (f" of bus {bus}" if bus else "")
            faults.add(f"line {line}, node_id", seen, f"a patch of the arm{which}")
            continue
        p, force = int(is_own.argmax()), row.get("force_n", math.nan)
        gain = arm.tactel_gain[arm.tactels_of(p)]
        readings, noise = (
            gain * [row.get(f"{letter}{k}", math.nan) for k in range(1, 1 + len(gain))] for letter in "pn"
        )
        if force < 0.0:
            wanted = "a positive number; 0 where nothing touches; or nothing"
            faults.add(f"line {line}, force_n", force, wanted)
        elif np.isnan(readings).all():
            faults.add(f"line {line}", "no reading", f"some of p1 to p{len(gain)}")
        presses.append(Press(p, 1e-3 * row["s_mm"], 1e-3 * row["a_mm"], force, readings, line, np.abs(noise)))
    touching = [press for press in presses if press.force != 0.0]
    if 0 < (unknown := sum(math.isnan(press.force) for press in touching)) < len(touching):
        seen = f"empty in {unknown} of {len(touching)} presses"
        faults.add("force_n", seen, "all of them, or none if it is the same in all")
    if not (touching or faults):
        faults.add("file", None, "presses")
    if faults:
        raise ConfigError(path, faults)
    for press in touching:
        if zeros := [own.readings for own in presses if own.patch == press.patch and own.force == 0.0]:
            press.readings[:] -= np.nan_to_num(mean_and_noise(np.array(zeros))[0])
    return touching


def read_columns(
    path: Path, choices: Sequence[Sequence[str]], optional: Sequence[str] = ()
) -> dict[str, Floats]:
    """Return all columns of numbers, those of one of the choices among them.

    Where ``t_s`` is one of them, its times must grow.

    optional: columns that the caller reads if they are there

    Raises:
        ConfigError: the columns of no choice are there, or values are no numbers, all faults.
    """
    names, rows, faults = _read(path, choices, optional)
    columns = {name: np.array([row.numbers[name] for row in rows]) for name in names}
    fewest = FEWEST if "t_s" in columns else 1
    if not faults and len(rows) < fewest:
        faults.add("file", f"{len(rows)} lines", f"{fewest} at least")
    elif not faults and not (np.diff(columns.get("t_s", [])) > 0.0).all():
        faults.add("t_s", "times that do not grow", "each later than the one before")
    if faults:
        raise ConfigError(path, faults)
    return columns


def write_presses(path: Path, arm: Arm, presses: Sequence[Press]) -> None:
    """Write a table of presses whole: a loss of power leaves the file as it was."""
    most = max(placed.patch.n_tactels for placed in arm.patches)
    tactels = [f"{letter}{k}" for letter in "pn" for k in range(1, 1 + most)]
    with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(["bus", *PRESSES[:3], "force_n", *tactels])
        for press in presses:
            placed, gain = arm.patches[press.patch], arm.tactel_gain[arm.tactels_of(press.patch)]
            read = np.full((2, most), np.nan)
            read[0, : len(gain)] = press.readings / gain
            if press.noise is not None:
                read[1, : len(gain)] = press.noise / gain
            numbers = placed.node_id, 1e3 * press.s, 1e3 * press.a, press.force, *read.ravel()
            cells = ("" if math.isnan(x) else f"{x:.6g}" for x in numbers)
            table.writerow([arm.buses[placed.bus].name, *cells])


def _read(
    path: Path, choices: Sequence[Sequence[str]], optional: Sequence[str]
) -> tuple[list[str], list[Row], FaultList]:
    """Return the names of columns, the rows without fault, and the faults of the others."""
    text = read_bytes(path, MAX_BYTES).decode("utf-8-sig", errors="replace")
    reader = csv.reader(io.StringIO(text, newline=""))
    rows, faults = list[Row](), FaultList()
    try:
        names = [name.strip() for name in next(filter(None, reader), [])]
        if misspelt := header_faults(names, choices, optional):
            raise ConfigError(path, misspelt)
        needed = {*next(choice for choice in choices if set(choice) <= set(names))} - {"p1"}
        for row in filter(None, reader):
            line, cells = reader.line_num, dict(zip(names, map(str.strip, row), strict=False))
            numbers = {name: _number(cell) for name, cell in cells.items()}
            wrong = [
                Fault(f"line {line}, {name}", cell or None, f"a number, at most {MOST:g}")
                for name, cell in cells.items()
                if (name in needed or (cell and OPTIONAL.fullmatch(name))) and not abs(numbers[name]) <= MOST
            ]
            if len(row) != len(names):
                wrong.append(
                    Fault(f"line {line}", f"{len(row)} values", f"{len(names)} values, as in line 1")
                )
            if not wrong:
                rows.append(Row(line, numbers, cells.get("bus", "")))
            faults += wrong
    except csv.Error as error:
        raise ConfigError.of(path, f"line {reader.line_num}", None, f"a line of a table: {error}") from None
    return names, rows, faults


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
