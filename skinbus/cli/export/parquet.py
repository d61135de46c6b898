"""Readings and contacts as Parquet: one row for each tactel of each cycle, and one for each contact."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from skinbus.cli.recorded import COVARIANCES, READING, RecordedCycle, values_of
from skinbus.model import Arm

CONTACTS: Final = pa.schema(
    [
        ("t_ns", pa.int64()),
        ("cycle", pa.int32()),
        ("id", pa.uint8()),
        ("identity", pa.int64()),
        *((name, pa.string()) for name in ("state", "link", "quality", "level")),
        *((name, pa.float64()) for name in ("s_m", "a_m", "force_n", "x_m", "y_m", "z_m")),
        *((name, pa.float64()) for name in ("normal_x", "normal_y", "normal_z", *COVARIANCES)),
    ]
)
ROWS: Final = 100_000
"""Readings that are written at once: a row group."""


class Writer:
    """Writes both tables."""

    def __init__(self, readings: Path, contacts: Path, arm: Arm, about: dict[str, str]) -> None:
        self._about, self._files = about, (readings, contacts)
        self._links = np.array([link.name for link in arm.links])
        self._buses = np.array([bus.name for bus in arm.buses])
        self._writers: dict[Path, Any] = {}
        self._readings, self._contacts, self._n = [np.zeros(0, READING)], list[Any](), 0

    def add(self, cycle: RecordedCycle) -> None:
        """Add a cycle."""
        self._readings.append(cycle.readings)
        about = {"t_ns": cycle.t_ns, "cycle": cycle.number}
        self._contacts += [about | values_of(contact) for contact in cycle.contacts]
        self._n += len(cycle.readings)
        if self._n >= ROWS:
            self._write()

    def close(self) -> None:
        """Write what is left, and finish both files."""
        self._write()
        for writer in self._writers.values():
            writer.close()

    def _write(self) -> None:
        rows = np.concatenate(self._readings)
        columns = {name: np.ascontiguousarray(rows[name]) for name in READING.names or ()}
        columns |= {"bus": self._buses[rows["bus"]], "link": self._links[rows["link"]]}
        arrays = {name: pa.array(column, from_pandas=True) for name, column in columns.items()}  # NaN is null
        for file, table in zip(
            self._files, (pa.table(arrays), pa.Table.from_pylist(self._contacts, CONTACTS)), strict=True
        ):
            made = table.replace_schema_metadata(self._about)
            if file not in self._writers:
                self._writers[file] = pq.ParquetWriter(file, made.schema, compression="zstd")
            self._writers[file].write_table(made)
        self._readings, self._contacts, self._n = self._readings[:1], [], 0
