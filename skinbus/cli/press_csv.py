"""Presses at known places, from a CSV file: what the command that calibrates learns from."""

from __future__ import annotations

import csv
import io
import math
import re
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.config.wording import header_faults, nearest
from skinbus.errors import ConfigError, Fault, FaultList
from skinbus.estimate.presses.kinds import Press
from skinbus.model import Arm
from skinbus.objects.file_bytes import read_bytes
from skinbus.skin.addresses import bus_numbers

Floats = npt.NDArray[np.float64]

COUNTS, PASCALS = "c", "p"
"""First letter of the columns of readings: c1, c2, ... as they are on the wire, or p1, p2, ... in Pa.
Gains of the board are in neither: they change with each calibration from the same presses."""
NOISE: Final = "n"
"""First letter of the columns of noise, in the unit of the readings."""
MAX_BYTES: Final = 16 << 20
"""Fifty thousand presses of 64 tactels."""
MOST_READ: Final = 2.0**32
"""Counts have 32 bits at most, and 4 GPa is beyond any skin; what follows overflows nowhere."""
_ALWAYS: Final = ("node_id", "s_mm", "a_mm")
_FORCE: Final = "force_n"
_BESIDE: Final = frozenset(("", "t", "t_s", "time", "time_s", "line", "bus", "note", "comment"))
"""Names of columns, in small letters, that cannot be meant for one that is read."""
_WANTED: Final = "node_id, s_mm, a_mm, and c1, c2, ... or p1, p2, ...; force_n and n1, n2, ... if known"


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
    text = read_bytes(path, MAX_BYTES).decode("utf-8-sig", errors="replace")
    rows = csv.DictReader(io.StringIO(text, newline=""))
    try:
        names = [name.strip() for name in rows.fieldnames or ()]
    except csv.Error as error:
        raise ConfigError(str(path), [_no_table(rows.reader.line_num, error)]) from None
    rows.fieldnames = names
    table = _Table(arm, only, names)
    faults = table.faults
    try:
        for row in rows if not faults else ():
            table.take(row, rows.line_num)
    except csv.Error as error:
        faults.append(_no_table(rows.reader.line_num, error))
    if not table.is_refused:
        _check_forces(table.presses, faults)
        _check_width(arm, table.presses, names, table.kind, faults)
    if faults:
        raise ConfigError(str(path), faults)
    known = [name for name in (*_ALWAYS, _FORCE) if name not in names]
    unread = [f"{name!r}{nearest(name, known)}" for name in _unknown(names)]
    presses, repeated = _without_repeats(_without_zeros(table.presses))
    return PressFile(presses, unread, repeated)


def _no_table(line: int, error: csv.Error) -> Fault:
    return Fault(f"line {line}", None, f"a line of a table: {error}")


class _Table:
    """Presses and faults of a table, row by row."""

    def __init__(self, arm: Arm, bus: int | None, names: list[str]) -> None:
        self.arm = arm
        self.presses: list[Press] = []
        self.kind = COUNTS if "c1" in names else PASCALS
        needed = [(*_ALWAYS, f"{letter}1") for letter in (COUNTS, PASCALS)]
        wrong = header_faults(names, needed, _WANTED, [_FORCE])
        self.faults = FaultList(wrong or _gaps(names, self.kind) or _forceless(names))
        self.is_refused = bool(self.faults)
        """Whether no row is read, because the columns are wrong."""
        self._bus = bus
        self._names_bus = "bus" in names and len(arm.buses) > 1

    def take(self, row: dict[str, str | None], line_num: int) -> None:
        """Add what a row says, or its faults."""
        faults, line, kind = FaultList(), f"line {line_num}", self.kind

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
            faults.append(
                Fault(line, "more values than columns", "a value for each column, points in numbers")
            )
        node_id, s, a = number("node_id"), number("s_mm"), number("a_mm")
        force = number("force_n", empty=True)
        if force < 0.0:
            wanted = "a positive number; 0 where nothing touches; or nothing"
            faults.append(Fault(f"{line}, force_n", force, wanted))
        if not math.isfinite(node_id) or (p := self._patch(node_id, row, line, faults)) is None:
            self.faults.extend(faults)
            return
        patch, here = self.arm.patches[p].patch, self.arm.tactels_of(p)
        readings, noise = (
            np.array([number(f"{letter}{k + 1}", empty=True) for k in range(patch.n_tactels)])
            for letter in (kind, NOISE)
        )
        if (noise < 0.0).any():
            faults.append(Fault(f"{line}, {NOISE}1 ...", float(np.nanmin(noise)), "standard deviations"))
        for name, column in ((kind, readings), (NOISE, noise)):
            if (np.abs(column) > MOST_READ).any():
                most = float(np.nanmax(np.abs(column)))
                faults.append(Fault(f"{line}, {name}1 ...", most, f"at most {MOST_READ:g}"))
        if np.isnan(readings).all() and not faults:
            faults.append(Fault(line, "no reading", f"some of {kind}1 to {kind}{patch.n_tactels}"))
        if faults:
            self.faults.extend(faults)
            return
        is_single = kind == COUNTS and bool((np.isnan(readings) | (readings == np.rint(readings))).all())
        scale = np.asarray(self.arm.tactel_gain[here])
        if kind == COUNTS:
            readings, scale = readings - self.arm.tactel_offset[here], patch.transducer.step * scale
        readings, noise = readings * scale, noise * scale
        self.presses.append(Press(p, 1e-3 * s, 1e-3 * a, force, readings, line_num, noise, is_single))

    def _patch(self, node_id: float, row: dict[str, str | None], line: str, faults: FaultList) -> int | None:
        """Return the patch of a row; where none is meant, add why."""
        found = self.arm.patches_named(int(node_id)) if node_id == int(node_id) else []
        key, known = f"{line}, bus", " or ".join(settings.name for settings in self.arm.buses)
        if not found:
            faults.append(Fault(f"{line}, node_id", f"{node_id:g}", "a patch of the arm"))
            return None
        bus, names = self._bus, [settings.name for settings in self.arm.buses]
        if self._names_bus:
            name = (row["bus"] or "").strip()
            if name not in names or (bus is not None and name != names[bus]):
                wanted = f"{names[bus]}, as --bus says" if bus is not None and name in names else known
                faults.append(Fault(key, name or None, wanted))
                return None
            bus = names.index(name)
        if bus is not None:
            own = names[self.arm.patch_bus[found[0]]]
            found = [p for p in found if self.arm.patch_bus[p] == bus]
            if not found:
                faults.append(Fault(key, names[bus], f"{own}, which has node {node_id:g}"))
                return None
        if len(found) > 1:
            wanted = f"it, or --bus, as node-IDs repeat: {known}"
            if all(fault.key != "column bus" for fault in self.faults):
                faults.append(Fault("column bus", None, wanted))
            return None
        return found[0]


def _unknown(names: list[str]) -> list[str]:
    """Return the names of columns that are neither read nor known to stand beside what is read."""
    read = re.compile(rf"[{COUNTS}{PASCALS}{NOISE}][1-9]\d{{0,3}}")
    rest = [name for name in names if name not in (*_ALWAYS, _FORCE) and not read.fullmatch(name)]
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


def _check_forces(presses: list[Press], faults: list[Fault]) -> None:
    pressed = [press.force for press in presses if press.force != 0.0]
    unknown = sum(map(math.isnan, pressed))
    if 0 < unknown < len(pressed):
        seen = f"empty in {unknown} of {len(pressed)} presses"
        faults.append(Fault("force_n", seen, "all of them, or none if it is the same in all"))
    if not pressed and not faults:
        faults.append(Fault("file", None, "presses"))


def _check_width(arm: Arm, presses: list[Press], names: list[str], kind: str, faults: list[Fault]) -> None:
    """Add that a board has more tactels than the file has columns of readings."""
    widest = max(
        (press.patch for press in presses), key=lambda p: arm.patches[p].patch.n_tactels, default=None
    )
    if widest is None:
        return
    n, have = arm.patches[widest].patch.n_tactels, sum(f"{kind}{k + 1}" in names for k in range(len(names)))
    if have < n:
        wanted = (
            f"columns to {kind}{n}: node {arm.node_label(widest)} has {n} tactels; "
            "a cell is empty where there is no reading"
        )
        faults.append(Fault("line 1", f"{kind}1 to {kind}{have}", wanted))


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
