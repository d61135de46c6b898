"""CSV files of others: presses at known places, and columns of numbers over time (poses, forces)."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.cli.output import whole_file
from skinbus.config.wording import header_faults
from skinbus.errors import ConfigError, Fault, FaultList
from skinbus.estimate.calibration.table import Press, mean_and_noise
from skinbus.file_bytes import read_bytes
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]

MAX_BYTES: Final = 256 << 20
"""An hour of poses at 1 kHz."""
FEWEST: Final = 10
"""Lines of columns over time."""
MOST: Final = 2.0**32
"""Counts have 32 bits at most, and 4 GPa is beyond any skin; what follows overflows nowhere."""
PLACE: Final = ("node_id", "s_mm", "a_mm")
CHOICES: Final = ((*PLACE, "c1"), (*PLACE, "p1"))
"""Readings are c1, c2, ... as they are on the wire, or p1, p2, ... in Pa; gains of the board are in neither:
they change with each calibration from the same presses."""
WANTED: Final = "node_id, s_mm, a_mm, and c1, c2, ... or p1, p2, ...; force_n and n1, n2, ... if known"
OPTIONAL: Final = re.compile(r"force_n|[cpn][1-9]\d{0,3}")
"""Columns that are read where they are there; n1, n2, ... are noise in the unit of the readings."""

Row = tuple[int, dict[str, float], str]
"""Line, numbers by column (NaN for a cell that is none), and the name of a bus."""


def read_presses(arm: Arm, path: Path) -> list[Press]:
    """Return the presses in a file, less the zeros in rows without a touch (force 0).

    Raises:
        ConfigError: faults of the file, all of them; keys are line and column.
    """
    names, rows, faults = _read(path, CHOICES, WANTED, ["force_n"])
    kind, several = "c" if "c1" in names else "p", " or ".join(bus.name for bus in arm.buses)
    which = f"; a column bus with {several}, where node-IDs repeat" if len(arm.buses) > 1 else ""
    patches: dict[tuple[float, str], int] = {}
    for p, placed in enumerate(arm.patches):
        for key in {(placed.node_id, ""), (placed.node_id, arm.buses[placed.bus].name)}:
            patches[key] = -1 if key in patches else p  # not clear without the name of a bus
    presses: list[Press] = []
    for line, row, bus in rows:
        p = patches.get((row["node_id"], bus if which else ""), -1)
        here, force = arm.tactels_of(max(p, 0)), row.get("force_n", math.nan)
        n, scale = here.stop - here.start, np.asarray(arm.tactel_gain[here])
        readings, noise = (
            np.array([row.get(f"{letter}{k + 1}", math.nan) for k in range(n)]) for letter in (kind, "n")
        )
        if p < 0:
            seen = f"{row['node_id']:g}" + (f" of bus {bus}" if bus else "")
            faults.append(Fault(f"line {line}, node_id", seen, f"a patch of the arm{which}"))
        elif force < 0.0:
            wanted = "a positive number; 0 where nothing touches; or nothing"
            faults.append(Fault(f"line {line}, force_n", force, wanted))
        elif np.isnan(readings).all():
            faults.append(Fault(f"line {line}", "no reading", f"some of {kind}1 to {kind}{n}"))
        is_single = kind == "c" and bool((np.isnan(readings) | (readings == np.rint(readings))).all())
        if kind == "c":
            readings, scale = readings - arm.tactel_offset[here], scale * arm.patches[p].patch.transducer.step
        s, a = 1e-3 * row["s_mm"], 1e-3 * row["a_mm"]
        presses.append(Press(p, s, a, force, readings * scale, line, np.abs(noise) * scale, is_single))
    forces = np.array([press.force for press in presses if press.force != 0.0])
    if 0 < (unknown := int(np.isnan(forces).sum())) < len(forces):
        seen = f"empty in {unknown} of {len(forces)} presses"
        faults.append(Fault("force_n", seen, "all of them, or none if it is the same in all"))
    if not (len(forces) or faults):
        faults.append(Fault("file", None, "presses"))
    if faults:
        raise ConfigError(str(path), faults)
    for p in {press.patch for press in presses if press.force == 0.0}:
        own = [press for press in presses if press.patch == p]
        zero, _ = mean_and_noise(np.array([press.readings for press in own if press.force == 0.0]))
        for press in own:
            press.readings[:] -= np.nan_to_num(zero)
    return [press for press in presses if press.force != 0.0]


def read_columns(
    path: Path, choices: Sequence[Sequence[str]], optional: Sequence[str] = ()
) -> dict[str, Floats]:
    """Return all columns of numbers, those of one of the choices among them.

    Where ``t_s`` is one of them, its times must grow.

    optional: columns that the caller reads if they are there

    Raises:
        ConfigError: the columns of no choice are there, or values are no numbers, all faults.
    """
    names, rows, faults = _read(path, choices, " or ".join(map(", ".join, choices)), optional)
    columns = {name: np.array([row[name] for _, row, _ in rows]) for name in names}
    fewest = FEWEST if "t_s" in columns else 1
    if not faults and len(rows) < fewest:
        faults.append(Fault("file", f"{len(rows)} lines", f"{fewest} at least"))
    elif not faults and not (np.diff(columns.get("t_s", [])) > 0.0).all():
        faults.append(Fault("t_s", "times that do not grow", "each later than the one before"))
    if faults:
        raise ConfigError(str(path), faults)
    return columns


def columns_of(arm: Arm) -> list[str]:
    """Return the columns of a table of presses on an arm."""
    numbers = range(1, 1 + max(placed.patch.n_tactels for placed in arm.patches))
    return ["bus", *PLACE, "force_n", *(f"{letter}{k}" for letter in "pn" for k in numbers)]


def write_presses(path: Path, arm: Arm, presses: Sequence[Press]) -> None:
    """Write a table of presses whole: a loss of power leaves the file as it was."""
    most = max(placed.patch.n_tactels for placed in arm.patches)
    with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(columns_of(arm))
        for press in presses:
            placed, gain = arm.patches[press.patch], arm.tactel_gain[arm.tactels_of(press.patch)]
            values = np.full((2, most), np.nan)
            values[0, : len(gain)] = press.readings / gain
            values[1, : len(gain)] = np.nan if press.noise is None else press.noise / gain
            cells = (placed.node_id, 1e3 * press.s, 1e3 * press.a, press.force, *values.flat)
            table.writerow(
                [arm.buses[placed.bus].name, *("" if math.isnan(x) else f"{x:.6g}" for x in cells)]
            )


def _read(
    path: Path,
    choices: Sequence[Sequence[str]],
    wanted: str,
    optional: Sequence[str],
) -> tuple[list[str], list[Row], FaultList]:
    """Return the names of columns, the rows without fault, and the faults of the others."""
    text = read_bytes(path, MAX_BYTES).decode("utf-8-sig", errors="replace")
    reader = csv.reader(io.StringIO(text, newline=""))
    rows, faults = list[Row](), FaultList()
    try:
        names = [name.strip() for name in next(filter(None, reader), [])]
        if wrong := header_faults(names, choices, wanted, optional):
            raise ConfigError(str(path), wrong)
        needed = {*next(choice for choice in choices if set(choice) <= set(names))} - {"c1", "p1"}
        for row in filter(None, reader):
            key, cells = f"line {reader.line_num}", dict(zip(names, map(str.strip, row), strict=False))
            numbers = {name: _number(cell) for name, cell in cells.items()}
            wrong = [
                Fault(f"{key}, {name}", cell or None, f"a number, at most {MOST:g}")
                for name, cell in cells.items()
                if (name in needed or (cell and OPTIONAL.fullmatch(name))) and not abs(numbers[name]) <= MOST
            ]
            if len(row) != len(names):
                wrong.append(Fault(key, f"{len(row)} values", f"{len(names)} values, as in line 1"))
            if not wrong:
                rows.append((reader.line_num, numbers, cells.get("bus", "")))
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
