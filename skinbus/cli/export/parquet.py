"""Readings and contacts as Parquet: one row for each tactel of each frame, and one for each contact."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from skinbus.cli.export.rows import LogPart, level_of, quality_of, state_name
from skinbus.model import Arm
from skinbus.skin.cycle import link_name

COVARIANCES: Final = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
AXES: Final = ("s", "a", "force")


class ParquetFiles:
    """Writes both tables, part by part."""

    def __init__(self, readings: Path, contacts: Path, arm: Arm, about: dict[str, str]) -> None:
        self._arm, self._about, self._files = arm, about, (readings, contacts)
        self._writers: dict[Path, Any] = {}
        starts = arm.patch_start[arm.tactel_patch]
        self._tactel = (np.arange(arm.n_tactels) - starts + 1).astype(np.uint8)
        self._patch = {
            "bus": pa.array([arm.buses[placed.bus].name for placed in arm.patches]),
            "node_id": pa.array(arm.node_id.astype(np.uint8)),
            "link": pa.array([arm.links[placed.link].name for placed in arm.patches]),
        }

    def add(
        self,
        part: LogPart,
        pressure: npt.NDArray[np.float64],
        zeroed: npt.NDArray[np.float32] | None,
        recomputed: npt.NDArray[Any] | None,
    ) -> None:
        """Add a part with its pressures, Pa, and what a master makes of it, None for none."""
        rows = part.readings
        patch = pa.array(self._arm.tactel_patch[rows["tactel"]])
        columns: dict[str, Any] = {
            "t_ns": rows["t_ns"],
            "cycle": rows["cycle"],
            **{name: values.take(patch) for name, values in self._patch.items()},
            "tactel": self._tactel[rows["tactel"]],
            "counts": rows["counts"],
            "pressure_pa": pressure,
        }
        if zeroed is not None:
            columns["zeroed_pa"] = pa.array(zeroed, mask=np.isnan(zeroed))
        self._write(self._files[0], columns)
        self._write(self._files[1], self._contacts("published", part.contacts))
        if recomputed is not None:
            self._write(self._files[1], self._contacts("recomputed", recomputed))

    def _contacts(self, source: str, rows: npt.NDArray[Any]) -> dict[str, Any]:
        """Return the columns of contacts (of LOGGED)."""
        contact, links = rows["contact"], [link.name for link in self._arm.links]
        is_nowhere, no_covariance = contact["link"] >= len(links), contact["has_covariance"] == 0

        def column(values: npt.NDArray[Any], is_null: npt.NDArray[np.bool_]) -> Any:
            return pa.array(np.ascontiguousarray(values), mask=is_null)

        def words(values: list[str | None]) -> Any:
            return pa.array(values, pa.string())

        return {
            "source": words([source] * len(rows)),
            "t_ns": rows["t_ns"],
            "cycle": rows["cycle"],
            "id": contact["id"].astype(np.uint8),
            "identity": column(contact["identity"].astype(np.int64), contact["identity"] == 0),
            "state": words([state_name(one) for one in contact["state"]]),
            "link": words([link_name(links, one) for one in contact["link"].tolist()]),
            **{f"{name}_{unit}": contact[name] for name, unit in (("s", "m"), ("a", "m"), ("force", "n"))},
            **{f"{x}_m": column(contact["point"][:, k], is_nowhere) for k, x in enumerate("xyz")},
            **{f"normal_{x}": column(contact["normal"][:, k], is_nowhere) for k, x in enumerate("xyz")},
            **{
                f"cov_{AXES[p]}_{AXES[q]}": column(contact["covariance"][:, p, q], no_covariance)
                for p, q in COVARIANCES
            },
            "quality": words([quality_of(one) for one in contact]),
            "level": words([level_of(one) for one in contact]),
        }

    def _write(self, file: Path, columns: dict[str, Any]) -> None:
        table = pa.table(columns)
        if file not in self._writers:
            schema = table.schema.with_metadata(self._about)
            self._writers[file] = pq.ParquetWriter(file, schema, compression="zstd")
        self._writers[file].write_table(table.replace_schema_metadata(self._about))

    def close(self) -> None:
        """Finish both files."""
        for writer in self._writers.values():
            writer.close()
