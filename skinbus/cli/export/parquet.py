"""Readings and contacts as Parquet: one row for each tactel of each cycle, and one for each contact."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from skinbus.cli.recorded import CONTACT_COLUMNS, READING, RecordedCycle, values_of
from skinbus.model import Arm

CONTACTS: Final = pa.schema(
    [
        *zip(
            CONTACT_COLUMNS,
            (pa.int64(), pa.int32(), pa.uint8(), pa.int64(), *[pa.string()] * 4),
            strict=False,
        ),
        *((name, pa.float64()) for name in CONTACT_COLUMNS[8:]),
    ]
)
ROWS: Final = 100_000
"""Readings that are written at once: a row group."""


def write(
    cycles: Iterable[RecordedCycle], file: Path, contacts: Path, arm: Arm, about: dict[str, str]
) -> None:
    """Write both tables."""
    names = {
        "bus": np.array([bus.name for bus in arm.buses]),
        "link": np.array([link.name for link in arm.links]),
    }
    rows, found = list[Any](), list[dict[str, Any]]()

    def table() -> pa.Table:
        all_rows = np.concatenate([np.zeros(0, READING), *rows])
        columns = {name: np.ascontiguousarray(all_rows[name]) for name in READING.names or ()}
        columns |= {name: words[columns[name]] for name, words in names.items()}
        return pa.table({name: pa.array(column, from_pandas=True) for name, column in columns.items()})

    schemas = [schema.with_metadata(about) for schema in (table().schema, CONTACTS)]
    with (
        pq.ParquetWriter(file, schemas[0], compression="zstd") as readings_writer,
        pq.ParquetWriter(contacts, schemas[1], compression="zstd") as contacts_writer,
    ):

        def write_out() -> None:
            readings_writer.write_table(table().replace_schema_metadata(about))
            contacts_writer.write_table(pa.Table.from_pylist(found, schemas[1]))
            rows.clear()
            found.clear()

        for cycle, t_ns, readings in cycles:
            rows.append(readings)
            moment = {"t_ns": t_ns, "cycle": cycle.number}
            found += [moment | values_of(contact) for contact in cycle.contacts]
            if sum(map(len, rows)) >= ROWS:
                write_out()
        write_out()
