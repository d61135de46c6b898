"""What a master has learned and a restart must not lose: zeros, health of tactels, contacts, identities.

It is kept as plain tables, for each patch under its bus and node-ID. A patch takes its part up again if it is
the same board with the same calibration; the variance of a zero grows with the time that has passed, and a
tactel whose zero has become too uncertain for its threshold begins as at power-on. A contact is taken up with
the first readings of its patch: if it is still there it keeps its identity, otherwise it is lifted.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from skinbus.arrays import Floats
from skinbus.estimate.baseline import KeptZeros
from skinbus.estimate.tracking import KeptTrack
from skinbus.master.cycle import Cycle
from skinbus.model import Arm

DIGITS = 8
"""Significant digits of a pressure: a ten-thousandth of the noise of any converter."""

COLUMNS = {
    "zero_Pa": "zero",
    "zero_variance_Pa2": "doubt",
    "band_centre_Pa": "centre",
    "noise_variance_Pa2": "variance",
    "zeroed": "zeroed",
    "touched": "touched",
    "pressed_Pa": "pressed",
}
"""Keys of a patch, and the columns of ``KeptZeros`` that they hold."""

SIGNED = ("zero_Pa", "band_centre_Pa")

MAX_NUMBER = 1e15
"""Pa or Pa^2: no zero and no variance is larger."""

CONTACT_S = 30.0
"""A contact is taken up after so long at most, s: a restart, and the boot of all patches."""


@dataclass(slots=True)
class Resumed:
    """What came of a state."""

    n_zeros: int = 0
    stale: dict[int, int] = field(default_factory=dict)
    """Tactels whose zero is too old, by patch."""
    strangers: list[str] = field(default_factory=list)
    """Patches of the state that are not those of the arm."""


class Memory:
    """Reads and writes what the stages of a master hold between cycles."""

    def __init__(self, cycle: Cycle) -> None:
        self._arm = arm = cycle.arm
        self._cycle = cycle
        self._baseline = cycle.baseline
        self._plausibility = cycle.plausibility
        self._tracker = cycle.tracker
        self._names = names_of(arm)
        self._prints = [fingerprint(arm, p) for p in range(arm.n_patches)]

    def snapshot(self) -> dict[str, Any]:
        """Return copies of all that is to be kept, soon: arrays, for :func:`as_tables`."""
        return {
            "zeros": self._baseline.kept(),
            "faults": self._plausibility.faults.copy(),
            "tracks": self._tracker.kept(),
            "last": self._tracker.last,
        }

    def as_tables(self, snapshot: dict[str, Any]) -> dict[str, Any]:
        """Return a snapshot as tables of numbers and texts."""
        arm, zeros = self._arm, snapshot["zeros"]
        patches = {}
        for p, name in enumerate(self._names):
            here = arm.tactels_of(p)
            columns = {key: digits_of(getattr(zeros, column)[here]) for key, column in COLUMNS.items()}
            patches[name] = {
                "board": self._prints[p],
                **columns,
                "faults": snapshot["faults"][here].tolist(),
            }
        identity, number = snapshot["last"]
        return {
            "arm": arm.name,
            "patches": patches,
            "contacts": [
                track._asdict() | {"patch": self._names[track.patch]} for track in snapshot["tracks"]
            ],
            "last_identity": identity,
            "last_id": number,
        }

    def resume(self, tables: dict[str, Any], age_s: float) -> Resumed:
        """Take up a state that is ``age_s`` old; what does not fit the arm is left out, nothing raises."""
        arm, found = self._arm, Resumed()
        patches = table_in(tables.get("patches"))
        fits = np.zeros(arm.n_patches, np.bool_)
        for p, name in enumerate(self._names):
            kept = table_in(patches.get(name))
            columns = self._columns(p, kept)
            if columns is None:
                if kept:
                    found.strangers.append(name)
                continue
            fits[p] = True
            taken = self._baseline.resume(p, columns, age_s)
            n_zeroed = int(columns.zeroed.sum())
            found.n_zeros += taken
            if taken:
                self._cycle.keep_zero(p)
            if taken < n_zeroed:
                found.stale[p] = n_zeroed - taken
            faults = numbers_in(kept.get("faults"), len(columns.zero), 0.0)
            if faults is not None:
                self._plausibility.resume(p, faults.astype(np.int64))
        last = numbers_in([tables.get(key) for key in ("last_identity", "last_id")], 2, 0.0)
        if last is not None:
            identity, number = last.astype(int).tolist()
            self._tracker.last = max(identity, self._tracker.last[0]), number
        rows = tables.get("contacts")
        for row in rows[:64] if age_s <= CONTACT_S and isinstance(rows, list) else ():
            track = self._track(table_in(row))
            if track is not None and fits[track.patch]:
                self._tracker.resume(track, CONTACT_S - age_s)
        return found

    def _columns(self, p: int, kept: dict[str, Any]) -> KeptZeros | None:
        """Return the zeros of a patch, None if they are not of this board or not whole."""
        if kept.get("board") != self._prints[p]:
            return None
        n = self._arm.patches[p].patch.n_tactels
        least = dict.fromkeys(SIGNED, -MAX_NUMBER)
        found = {name: numbers_in(kept.get(key), n, least.get(key, 0.0)) for key, name in COLUMNS.items()}
        whole = {name: column for name, column in found.items() if column is not None}
        if len(whole) < len(found):
            return None
        flags = {name: whole[name] != 0.0 for name in ("zeroed", "touched")}
        return KeptZeros(**{**whole, **flags})

    def _track(self, row: dict[str, Any]) -> KeptTrack | None:
        """Return a contact, None if there is no such patch, or a number is none."""
        numbers = numbers_in([row.get(key) for key in ("identity", "id", "slot", "s", "a", "force")], 6)
        if numbers is None or row.get("patch") not in self._names:
            return None
        patch = self._names.index(row["patch"])
        link = self._arm.patches[patch].link
        length = self._arm.links[link].surface.length
        least, most = (1, 1, 0, 0.0, -1e3, 0.0), (MAX_NUMBER, 255, 255, length, 1e3, 1e5)
        if not ((numbers >= least) & (numbers <= most)).all():
            return None
        *whole, s, a, force = numbers.tolist()
        identity, number, slot = map(int, whole)
        return KeptTrack(identity, number, slot, link, patch, s, a, force)


def names_of(arm: Arm) -> list[str]:
    """Return the names of the patches of an arm in what is kept: bus and node-ID."""
    return [f"{arm.buses[placed.bus].name}/{placed.node_id}" for placed in arm.patches]


def fingerprint(arm: Arm, p: int) -> str:
    """Return what a zero of a patch depends on: its board, its serial number, and how counts become Pa."""
    placed, here = arm.patches[p], arm.tactels_of(p)
    columns = (arm.tactel_gain[here], arm.tactel_offset[here], arm.tactel_threshold[here])
    numbers = b"".join(np.ascontiguousarray(column, np.float64).tobytes() for column in columns)
    return f"{placed.serial}:{placed.patch.n_tactels}:{zlib.crc32(numbers):08x}"


def digits_of(column: Floats, digits: int = DIGITS) -> list[float | None]:
    """Return numbers as they are kept: with some significant digits, None where they are not known."""
    return [float(f"{v:.{digits}g}") if v == v else None for v in column.tolist()]


def table_in(value: Any) -> dict[str, Any]:
    """Return a table from a file; nothing where it is none."""
    return value if isinstance(value, dict) else {}


def numbers_in(value: Any, n: int, least: float = -MAX_NUMBER, *, may_miss: bool = False) -> Floats | None:
    """Return n numbers from a file, none below ``least``; None if they are not. A null may be NaN."""
    if not isinstance(value, list) or len(value) != n:
        return None
    numbers = [np.nan if v is None and may_miss else v for v in value]
    if not all(isinstance(v, int | float) and not abs(v) >= MAX_NUMBER for v in numbers):
        return None
    column = np.array(numbers, np.float64)
    is_missing = np.isnan(column) & may_miss
    return column if (is_missing | (column >= least)).all() else None
