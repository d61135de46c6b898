"""Presses at known places, from a CSV file: what the command that calibrates learns from."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.errors import ConfigError, Fault, FaultList
from skinbus.estimate.presses import PressTable
from skinbus.model import Arm
from skinbus.objects.file_bytes import read_bytes

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]

COUNTS, PASCALS = "c", "p"
"""First letter of the columns of readings: c1, c2, ... as they are on the wire, or p1, p2, ... in Pa."""
MAX_BYTES: Final = 16 << 20
"""Fifty thousand presses of 64 tactels."""
_WANTED: Final = "node_id, s_mm, a_mm, and c1, c2, ... or p1, p2, ..."


class Press(NamedTuple):
    """What one patch reads under one press."""

    patch: int
    s: float
    a: float
    force: float
    """N; NaN where it is not known, 0 where nothing touches."""
    readings: Floats
    """(n_tactels of the patch,) Pa; NaN for a missing one."""
    line: int = 0
    """Of the file, for messages."""


def read_presses(arm: Arm, path: Path) -> list[Press]:
    """Return the presses in a file; the zeros in rows without a touch (force 0) are subtracted.

    Raises:
        ConfigError: faults of the file, all of them; keys are line and column.
    """
    faults = FaultList()
    presses: list[Press] = []
    text = read_bytes(path, MAX_BYTES).decode("utf-8-sig", errors="replace")
    rows = csv.DictReader(io.StringIO(text, newline=""))
    try:
        names = [name.strip() for name in rows.fieldnames or ()]
        rows.fieldnames = names
        kind = COUNTS if "c1" in names else PASCALS
        if not {"node_id", "s_mm", "a_mm", f"{kind}1"} <= set(names):
            raise ConfigError(str(path), [Fault("line 1", ", ".join(names) or None, f"columns {_WANTED}")])
        for row in rows:
            own: list[Fault] = []
            _take(arm, row, rows.line_num, kind, presses, own)
            faults.extend(own)
            if faults.n_more:
                break  # it is not such a file, or all of it has the same fault
    except csv.Error as error:
        faults.append(Fault(f"line {rows.line_num}", None, f"a line of a table: {error}"))
    _check_forces(presses, faults)
    if faults:
        raise ConfigError(str(path), faults)
    return _without_zeros(presses)


def _take(
    arm: Arm, row: dict[str, str | None], line_num: int, kind: str, presses: list[Press], faults: list[Fault]
) -> None:
    """Add what a row says, or its faults."""
    n_before, line = len(faults), f"line {line_num}"

    def number(key: str, *, empty: bool = False) -> float:
        text = (row.get(key) or "").strip()
        if not text and empty:
            return math.nan
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            faults.append(Fault(f"{line}, {key}", text or None, "a number"))
        return value

    if None in row:
        faults.append(Fault(line, "more values than columns", "a value for each column"))
    node_id, s, a = number("node_id"), number("s_mm"), number("a_mm")
    force = number("force_n", empty=True)
    if force < 0.0:
        faults.append(
            Fault(f"{line}, force_n", force, "a positive number; 0 where nothing touches; or nothing")
        )
    found = arm.patches_named(int(node_id)) if math.isfinite(node_id) and node_id == int(node_id) else []
    if math.isfinite(node_id) and len(found) != 1:
        wanted = "a patch of the arm" if not found else "a node-ID that only one bus has"
        faults.append(Fault(f"{line}, node_id", f"{node_id:g}", wanted))
    if len(found) != 1:
        return
    patch = arm.patches[found[0]].patch
    readings = np.array([number(f"{kind}{k + 1}", empty=True) for k in range(patch.n_tactels)])
    if np.isnan(readings).all() and len(faults) == n_before:
        faults.append(Fault(line, "no reading", f"some of {kind}1 to {kind}{patch.n_tactels}"))
    if len(faults) > n_before:
        return
    if kind == COUNTS:
        here = arm.tactels_of(found[0])
        readings = (readings - arm.tactel_offset[here]) * (patch.transducer.step * arm.tactel_gain[here])
    presses.append(Press(found[0], 1e-3 * s, 1e-3 * a, force, readings, line_num))


def _check_forces(presses: list[Press], faults: list[Fault]) -> None:
    pressed = [press.force for press in presses if press.force != 0.0]
    unknown = sum(map(math.isnan, pressed))
    if 0 < unknown < len(pressed):
        seen = f"empty in {unknown} of {len(pressed)} presses"
        faults.append(Fault("force_n", seen, "all of them, or none if it is the same in all"))
    if not pressed and not faults:
        faults.append(Fault("file", None, "presses"))


def tables_of(arm: Arm, presses: list[Press]) -> list[tuple[PressTable, Ints]]:
    """Return the presses of each kind of board as a table, with the patches of the arm that it has.

    Boards are of a kind when they have the same tactels behind the same transducers: they share a law.
    """
    kinds: dict[tuple[Any, ...], list[int]] = {}
    for p in sorted({press.patch for press in presses}):
        kinds.setdefault(kind_of(arm, p), []).append(p)
    tables = []
    for patches in kinds.values():
        part = Arm(arm.name, arm.links, [arm.patches[p] for p in patches], *arm.buses)
        rows = [press for press in presses if press.patch in patches]
        pressures = np.full((len(rows), part.n_tactels), np.nan)
        patch = np.array([patches.index(press.patch) for press in rows], np.intp)
        for row, p, press in zip(pressures, patch, rows, strict=True):
            row[part.tactels_of(int(p))] = press.readings
        s, a, force = (np.array([getattr(press, name) for press in rows]) for name in ("s", "a", "force"))
        table = PressTable(
            arm=part, patch=patch, s=s, a=a, force=None if np.isnan(force[0]) else force, pressures=pressures
        )
        tables.append((table, np.array([press.line for press in rows], np.intp)))
    return tables


def kind_of(arm: Arm, p: int) -> tuple[Any, ...]:
    """Return what boards of a kind have in common; a mirrored board is of the kind of the others."""
    patch = arm.patches[p].patch
    uv = np.asarray(patch.tactels_uv)
    either = min(((uv * sign) + 0.0).tobytes() for sign in ((1.0, 1.0), (1.0, -1.0)))  # no -0.0
    return either, patch.diameter, patch.size, patch.transducer


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
