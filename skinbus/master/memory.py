"""What a master has learned and a restart must not lose: zeros, health of tactels, contacts, identities.

It is kept as plain tables, for each patch under its bus and node-ID. A patch takes its part up again if it is
the same board with the same calibration; the variance of a zero grows with the time that has passed, and a
tactel whose zero has become too uncertain for its threshold begins as at power-on. A contact is taken up with
the first readings of its patch: if it is still there it keeps its identity, otherwise it is lifted.
The file that holds the tables says whether they are whole: ``config.state_file``.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from skinbus.arrays import Floats
from skinbus.estimate.baseline import KeptZeros
from skinbus.estimate.tracking import KeptTrack
from skinbus.master.cycle import Cycle
from skinbus.model import Arm

DIGITS = 10
"""Significant digits: those of a serial number."""

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
        self._arm = cycle.arm
        self._cycle = cycle

    def snapshot(self) -> dict[str, Any]:
        """Return copies of all that is to be kept, soon: arrays, for :func:`as_tables`."""
        cycle = self._cycle
        zeros = cycle.baseline.kept()
        columns = {key: getattr(zeros, column) for key, column in COLUMNS.items()}
        columns["faults"] = cycle.plausibility.faults.copy()
        columns["serial"] = cycle.zeroed_serials[self._arm.tactel_patch]
        return {
            "columns": columns,
            "tracks": cycle.tracker.kept(),
            "last": cycle.tracker.last,
        }

    def as_tables(self, snapshot: dict[str, Any]) -> dict[str, Any]:
        """Return a snapshot as tables of numbers and texts."""
        arm, names, (identity, number) = self._arm, names_of(self._arm), snapshot["last"]
        return {
            "patches": tables_of(arm, snapshot["columns"]),
            "contacts": [track._asdict() | {"patch": names[track.patch]} for track in snapshot["tracks"]],
            "last_identity": identity,
            "last_id": number,
        }

    def resume(self, tables: dict[str, Any], age_s: float) -> Resumed:
        """Take up a state that is ``age_s`` old; what does not fit the arm is left out."""
        arm, found, tracker = self._arm, Resumed(), self._cycle.tracker
        names = names_of(arm)
        for p, name in enumerate(names):
            kept = tables["patches"].get(name)
            if kept is None:
                continue
            if kept["board"] != fingerprint(arm, p):
                found.strangers.append(name)
                continue
            columns = {column: np.array(kept[key], np.float64) for key, column in COLUMNS.items()}
            flags = {column: columns[column] != 0.0 for column in ("zeroed", "touched")}
            zeros = KeptZeros(**{**columns, **flags})
            taken = self._cycle.baseline.resume(p, zeros, age_s)
            self._cycle.zeroed_serials[p] = kept.get("serial", [0])[0]
            found.n_zeros += taken
            if taken:
                self._cycle.keep_zero(p)
            if n_stale := int(zeros.zeroed.sum()) - taken:
                found.stale[p] = n_stale
            self._cycle.plausibility.resume(p, np.array(kept["faults"], np.int64))
        tracker.last = max(tables["last_identity"], tracker.last[0]), tables["last_id"]
        own = {name: p for p, name in enumerate(names) if name not in found.strangers}
        for row in tables["contacts"] if age_s <= CONTACT_S else ():
            if (p := own.get(row["patch"], -1)) >= 0:
                track = KeptTrack(**row | {"patch": p, "link": arm.patches[p].link})
                tracker.resume(track, CONTACT_S - age_s)
        return found


def names_of(arm: Arm) -> list[str]:
    """Return the names of the patches of an arm in what is kept: bus and node-ID."""
    return [f"{arm.buses[placed.bus].name}/{placed.node_id}" for placed in arm.patches]


def fingerprint(arm: Arm, p: int) -> str:
    """Return what a zero of a patch depends on: its board, its serial number, and how counts become Pa."""
    placed, here = arm.patches[p], arm.tactels_of(p)
    columns = (arm.tactel_gain[here], arm.tactel_offset[here], arm.tactel_threshold[here])
    numbers = b"".join(np.ascontiguousarray(column, np.float64).tobytes() for column in columns)
    return f"{placed.serial}:{placed.patch.n_tactels}:{zlib.crc32(numbers):08x}"


def tables_of(arm: Arm, columns: Mapping[str, Floats]) -> dict[str, Any]:
    """Return columns (n_tactels,) as they are kept, by the names of the patches, and which boards these are.

    Numbers have some significant digits; those that are not known are None.
    """
    kept = {
        key: [float(f"{v:.{DIGITS}g}") if v == v else None for v in column.tolist()]
        for key, column in columns.items()
    }
    return {
        name: {"board": fingerprint(arm, p), **{key: own[arm.tactels_of(p)] for key, own in kept.items()}}
        for p, name in enumerate(names_of(arm))
    }
