"""Readings and contacts as Parquet: one row for each tactel of each cycle, and one for each contact."""

from __future__ import annotations

from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from skinbus.cli.export.recorded import READING, RecordedCycle, level_of, quality_of, state_of
from skinbus.model import Arm
from skinbus.skin.cycle import CONTACT, link_name

AXES: Final = ("s", "a", "force")
LOGGED: Final = np.dtype([("source", "u1"), ("t_ns", "<i8"), ("cycle", "<i4"), ("contact", CONTACT)])
"""A contact with its source, its time and the number of its cycle."""
SOURCES: Final = ("published", "recomputed")
ROWS: Final = 100_000
"""Readings that are written at once: a row group."""


class Writer:
    """Writes both tables."""

    def __init__(self, readings: Path, contacts: Path, arm: Arm, about: dict[str, str]) -> None:
        self._about, self._files = about, (readings, contacts)
        self._links, self._buses = [link.name for link in arm.links], [bus.name for bus in arm.buses]
        self._writers: dict[Path, Any] = {}
        self._clear()

    def _clear(self) -> None:
        self._readings, self._contacts, self._n = [np.zeros(0, READING)], [np.zeros(0, LOGGED)], 0

    def add(self, cycle: RecordedCycle) -> None:
        """Add a cycle."""
        self._readings.append(cycle.readings)
        for source, contacts in cycle.contacts.items():
            rows = np.zeros(len(contacts), LOGGED)
            rows["source"], rows["contact"] = SOURCES.index(source), contacts
            rows["t_ns"], rows["cycle"] = cycle.t_ns, cycle.number
            self._contacts.append(rows)
        self._n += len(cycle.readings)
        if self._n >= ROWS:
            self._write()

    def close(self) -> None:
        """Write what is left, and finish both files."""
        self._write()
        for writer in self._writers.values():
            writer.close()

    def _write(self) -> None:
        readings, contacts = np.concatenate(self._readings), np.concatenate(self._contacts)
        columns: dict[str, Any] = {name: readings[name] for name in READING.names or ()}
        columns |= {
            "bus": _named(readings["bus"], self._buses),
            "link": _named(readings["link"], self._links),
        }
        for file, table in zip(self._files, (columns, self._contact_columns(contacts)), strict=True):
            arrays = {
                name: pa.array(np.ascontiguousarray(column), from_pandas=True)  # NaN is null
                if isinstance(column, np.ndarray)
                else column
                for name, column in table.items()
            }
            made = pa.table(arrays).replace_schema_metadata(self._about)
            if file not in self._writers:
                self._writers[file] = pq.ParquetWriter(file, made.schema, compression="zstd")
            self._writers[file].write_table(made)
        self._clear()

    def _contact_columns(self, rows: Any) -> dict[str, Any]:
        contact = rows["contact"]
        covariance = np.where(contact["has_covariance"][:, None, None], contact["covariance"], np.nan)
        pairs = combinations_with_replacement(range(len(AXES)), 2)
        return {
            "source": _named(rows["source"], SOURCES),
            "t_ns": rows["t_ns"],
            "cycle": rows["cycle"],
            "id": contact["id"].astype(np.uint8),
            "identity": pa.array(contact["identity"].tolist(), pa.int64(), mask=contact["identity"] == 0),
            "state": pa.array(map(state_of, contact), pa.string()),
            "link": pa.array([link_name(self._links, k) for k in contact["link"].tolist()], pa.string()),
            **{f"{axis}_{unit}": contact[axis] for axis, unit in zip(AXES, "mmn", strict=True)},
            **{f"{x}_m": contact["point"][:, k] for k, x in enumerate("xyz")},
            **{f"normal_{x}": contact["normal"][:, k] for k, x in enumerate("xyz")},
            **{f"cov_{AXES[p]}_{AXES[q]}": covariance[:, p, q] for p, q in pairs},
            "quality": pa.array(map(quality_of, contact), pa.string()),
            "level": pa.array(map(level_of, contact), pa.string()),
        }


def _named(numbers: Any, names: Any) -> Any:
    return pa.array(names, pa.string()).take(pa.array(numbers))
