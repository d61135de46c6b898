"""Readings and contacts as Parquet: one row for each tactel of each cycle, and one for each contact."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from skinbus.cli.recorded import CONTACT_COLUMNS, READING, RecordedCycle, values_of
from skinbus.model import Arm

CONTACTS = pa.schema(
    [
        *zip(
            CONTACT_COLUMNS,
            (pa.int64(), pa.int32(), pa.uint8(), pa.int64(), *[pa.string()] * 4),
            strict=False,
        ),
        *((name, pa.float64()) for name in CONTACT_COLUMNS[8:]),
    ]
)
ROWS = 100_000
"""Readings that are written at once, about: a row group."""


def write(
    cycles: Iterable[RecordedCycle], file: Path, contacts: Path, arm: Arm, about: dict[str, str]
) -> None:
    """Write both tables."""
    names = {
        "bus": np.array([bus.name for bus in arm.buses]),
        "link": np.array([link.name for link in arm.links]),
    }

    def table_of(rows: npt.NDArray[Any]) -> pa.Table:
        columns = {name: np.ascontiguousarray(rows[name]) for name in READING.names or ()}
        columns |= {name: words[columns[name]] for name, words in names.items()}
        table = {name: pa.array(column, from_pandas=True) for name, column in columns.items()}
        return pa.table(table, metadata=about)

    cycles, n = iter(cycles), max(ROWS // arm.n_tactels, 1)
    schema, of_contacts = table_of(np.zeros(0, READING)).schema, CONTACTS.with_metadata(about)
    with (
        pq.ParquetWriter(file, schema, compression="zstd") as readings_writer,
        pq.ParquetWriter(contacts, of_contacts, compression="zstd") as contacts_writer,
    ):
        while some := [*islice(cycles, n)]:
            readings_writer.write_table(table_of(np.concatenate([one.readings for one in some])))
            found = [
                {"t_ns": t_ns, "cycle": cycle.number} | values_of(contact)
                for cycle, t_ns, _ in some
                for contact in cycle.contacts
            ]
            contacts_writer.write_table(pa.Table.from_pylist(found, of_contacts))
