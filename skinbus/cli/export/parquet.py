"""Readings and contacts as Parquet: one row for each tactel of each frame, and one for each contact."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from skinbus.cli.export.rows import state_name
from skinbus.cli.formatting import words_of
from skinbus.estimate import LEVELS
from skinbus.model import Arm
from skinbus.skin.cycle import link_name

COVARIANCES: Final = (("s", "s"), ("s", "a"), ("s", "force"), ("a", "a"), ("a", "force"), ("force", "force"))
"""Elements of the covariance, by column ``cov_s_s`` and so on: m2, m N, N2."""

READINGS: Final = pa.schema(
    [
        ("t_ns", pa.int64()),
        ("cycle", pa.int32()),
        ("bus", pa.dictionary(pa.int8(), pa.string())),
        ("node_id", pa.uint8()),
        ("link", pa.dictionary(pa.int16(), pa.string())),
        ("tactel", pa.uint8()),
        ("counts", pa.int32()),
        ("pressure_pa", pa.float64()),
        ("zeroed_pa", pa.float32()),
    ]
)

CONTACTS: Final = pa.schema(
    [
        ("source", pa.string()),
        ("t_ns", pa.int64()),
        ("cycle", pa.int32()),
        ("sync_counter", pa.uint8()),
        ("id", pa.uint8()),
        ("identity", pa.int64()),
        ("state", pa.string()),
        ("link", pa.string()),
        *((name, pa.float64()) for name in ("s_m", "a_m", "force_n")),
        *((f"{axis}_m", pa.float64()) for axis in "xyz"),
        *((f"normal_{axis}", pa.float64()) for axis in "xyz"),
        *((f"cov_{p}_{q}", pa.float64()) for p, q in COVARIANCES),
        ("quality", pa.string()),
        ("level", pa.string()),
    ]
)


class ParquetFiles:
    """Writes both tables, part by part."""

    def __init__(self, readings: Path, contacts: Path, arm: Arm, about: dict[str, str]) -> None:
        self._arm = arm
        columns = [name for name in READINGS.names if name != "zeroed_pa" or "level" in about]
        schema = pa.schema([READINGS.field(name) for name in columns])
        self._readings = pq.ParquetWriter(readings, schema.with_metadata(about), compression="zstd")
        self._contacts = pq.ParquetWriter(contacts, CONTACTS.with_metadata(about), compression="zstd")
        self._schema = schema
        tactel = np.concatenate([np.arange(1, p.patch.n_tactels + 1) for p in arm.patches])
        self._tactel = tactel.astype(np.uint8)

    def add_readings(
        self,
        rows: npt.NDArray[Any],
        pressure: npt.NDArray[np.float64],
        zeroed: npt.NDArray[np.float32] | None,
    ) -> None:
        """Add readings (of ROW) with their pressures, Pa, and those less the zeros, NaN where not used."""
        arm = self._arm
        patch = arm.tactel_patch[rows["tactel"]]
        columns = {
            "t_ns": rows["t_ns"],
            "cycle": rows["cycle"],
            "bus": _dictionary(arm.patch_bus[patch].astype(np.int8), [bus.name for bus in arm.buses]),
            "node_id": arm.node_id[patch].astype(np.uint8),
            "link": _dictionary(arm.patch_link[patch].astype(np.int16), [link.name for link in arm.links]),
            "tactel": self._tactel[rows["tactel"]],
            "counts": rows["counts"],
            "pressure_pa": pressure,
        }
        if zeroed is not None:
            columns["zeroed_pa"] = pa.array(zeroed, mask=np.isnan(zeroed))
        self._readings.write_table(pa.table(columns, self._schema))

    def add_contacts(self, source: str, rows: npt.NDArray[Any]) -> None:
        """Add contacts (of LOGGED) of one source."""
        if not len(rows):
            return
        arm, contact = self._arm, rows["contact"]
        links = [link.name for link in arm.links]
        is_known = contact["level"] < len(LEVELS)
        no_covariance = contact["has_covariance"] == 0
        levels = contact["level"].tolist()
        columns: dict[str, Any] = {
            "source": [source] * len(rows),
            "t_ns": rows["t_ns"],
            "cycle": rows["cycle"],
            "sync_counter": rows["sync"],
            "id": contact["id"].astype(np.uint8),
            "identity": pa.array(contact["identity"], mask=contact["identity"] == 0),
            "state": [state_name(state) for state in contact["state"].tolist()],
            "link": [link_name(links, link) for link in contact["link"].tolist()],
            "s_m": contact["s"],
            "a_m": contact["a"],
            "force_n": contact["force"],
            "quality": [
                words_of(q) if known else None
                for q, known in zip(contact["quality"].tolist(), is_known.tolist(), strict=True)
            ],
            "level": [LEVELS[level] if level < len(LEVELS) else None for level in levels],
        }
        is_nowhere = contact["link"] >= len(links)
        for k, axis in enumerate("xyz"):
            columns[f"{axis}_m"] = _column(contact["point"][:, k], is_nowhere)
            columns[f"normal_{axis}"] = _column(contact["normal"][:, k], is_nowhere)
        for p, q in COVARIANCES:
            element = contact["covariance"][:, _AXES.index(p), _AXES.index(q)]
            columns[f"cov_{p}_{q}"] = _column(element, no_covariance)
        self._contacts.write_table(pa.table(columns, CONTACTS))

    def close(self) -> None:
        """Finish both files."""
        self._readings.close()
        self._contacts.close()


_AXES: Final = ("s", "a", "force")


def _column(values: npt.NDArray[Any], is_null: npt.NDArray[np.bool_]) -> Any:
    return pa.array(np.ascontiguousarray(values), mask=is_null)


def _dictionary(indices: npt.NDArray[Any], names: list[str]) -> Any:
    return pa.DictionaryArray.from_arrays(pa.array(indices), pa.array(names))
