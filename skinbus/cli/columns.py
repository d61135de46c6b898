"""Columns of numbers from a CSV file of somebody else: poses of a tool, forces over time."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.config.wording import header_faults
from skinbus.errors import ConfigError, Fault, FaultList
from skinbus.objects.file_bytes import read_bytes

MAX_BYTES: Final = 256 << 20
"""An hour at 1 kHz."""
FEWEST: Final = 10


def read_columns(
    path: Path, choices: Sequence[Sequence[str]], optional: Sequence[str] = ()
) -> dict[str, npt.NDArray[np.float64]]:
    """Return all columns of numbers, those of one of the choices among them, in order of ``t_s``.

    optional: columns that the caller reads if they are there

    Raises:
        ConfigError: the columns of no choice are there, or values are no numbers, all faults.
    """
    text = read_bytes(path, MAX_BYTES).decode("utf-8-sig", errors="replace")
    rows = csv.reader(io.StringIO(text, newline=""))
    faults = FaultList()
    try:
        names = [name.strip() for name in next(rows, [])]
        choice = next((c for c in choices if set(c) <= set(names)), None)
        if choice is None:
            wanted = " or ".join(", ".join(c) for c in choices)
            raise ConfigError(str(path), header_faults(names, choices, wanted, optional))
        if wrong := header_faults(names, [choice], "", optional):
            raise ConfigError(str(path), wrong)
        numbers: list[list[float]] = []
        for row in rows:
            if not row:
                continue
            line = f"line {rows.line_num}"
            if len(row) != len(names):
                faults.append(Fault(line, f"{len(row)} values", f"{len(names)} values, as in line 1"))
                continue
            values = [_number(text) for text in row]
            for name in choice:
                if not math.isfinite(values[names.index(name)]):
                    faults.append(Fault(f"{line}, {name}", row[names.index(name)] or None, "a number"))
            numbers.append(values)
    except csv.Error as error:
        faults.append(Fault(f"line {rows.line_num}", None, f"a line of a table: {error}"))
    if not faults and len(numbers) < FEWEST:
        faults.append(Fault("file", f"{len(numbers)} lines", f"{FEWEST} at least"))
    if faults:
        raise ConfigError(str(path), faults)
    table = np.array(numbers)
    columns = {name: table[:, k] for k, name in enumerate(names)}
    if not (np.diff(columns["t_s"]) > 0.0).all():
        raise ConfigError(
            str(path), [Fault("t_s", "times that do not grow", "each later than the one before")]
        )
    return columns


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
