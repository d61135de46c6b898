"""A recording as MCAP with JSON messages, for Foxglove and Lichtblick.

======================== ===================== ==============================================
topic                    schema                contents
======================== ===================== ==============================================
/tf                      FrameTransforms       the links in a row, once
/arm                     SceneUpdate           links and boards, once
/pressures/LINK          PointCloud            counts and pressures of a link's tactels, each cycle
/readings                skinbus.Readings      pressures by patch in whole Pa, to plot; each cycle
/contacts/SOURCE         SceneUpdate           arrows, each cycle
/contacts/SOURCE/values  skinbus.Contacts      the same as numbers
======================== ===================== ==============================================

SOURCE is ``published`` (the master in the log) or ``recomputed``.
"""

from __future__ import annotations

import json
from base64 import b64encode
from typing import Any, BinaryIO, Final

import numpy as np
import numpy.typing as npt
from mcap.writer import CompressionType, Writer

from skinbus.cli.export import schemas
from skinbus.cli.export.rows import state_name
from skinbus.cli.export.scene import COLORS, arm_scene, contact_scene, time_of, transforms
from skinbus.cli.formatting import words_of
from skinbus.estimate import LEVELS
from skinbus.model import Arm
from skinbus.skin.cycle import link_name

POINT: Final = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("pressure", "<f4"),
        ("counts", "<i4"),
        ("node_id", "u1"),
        ("tactel", "u1"),
        ("bus", "u1"),
        ("pad", "u1"),
    ]
)
"""A tactel in a point cloud: m in the frame of the link, Pa, counts."""

_TYPES: Final = {"u1": 1, "i4": 6, "f4": 7}
_ORIGIN: Final = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}


class McapFile:
    """Writes messages, part by part; cycles are whole within a part."""

    def __init__(self, file: BinaryIO, arm: Arm, about: dict[str, str]) -> None:
        self._arm = arm
        self._links = [link.name for link in arm.links]
        self._writer = Writer(file, compression=CompressionType.ZSTD)
        self._writer.start(library="skinbus")
        self._writer.add_metadata("skinbus", about)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._n_messages: dict[str, int] = {}
        self._has_begun = False
        self._points = np.zeros(arm.n_tactels, POINT)
        for k, link in enumerate(arm.links):
            here = arm.tactel_link == k
            place, _ = link.surface.position(arm.tactel_s[here], arm.tactel_a[here])
            for column, axis in enumerate("xyz"):
                self._points[axis][here] = place[:, column]
        self._points["node_id"] = arm.node_id[arm.tactel_patch]
        self._points["bus"] = arm.patch_bus[arm.tactel_patch]
        self._points["tactel"] = np.concatenate([np.arange(1, p.patch.n_tactels + 1) for p in arm.patches])
        names = [name for name in POINT.names or () if name != "pad"]
        self._cloud = {
            "pose": _ORIGIN,
            "point_stride": POINT.itemsize,
            "fields": [
                {"name": name, "offset": POINT.fields[name][1], "type": _TYPES[POINT[name].str[1:]]}
                for name in names
                if POINT.fields
            ],
        }

    def add_readings(
        self, rows: npt.NDArray[Any], pressure: npt.NDArray[Any], begun: npt.NDArray[np.int64]
    ) -> None:
        """Add whole cycles: readings (of ROW), their pressures (Pa, NaN for none), when the cycles began."""
        if not len(rows):
            return
        self._begin(int(rows["t_ns"][0]))
        arm = self._arm
        times = dict(begun.tolist())
        points = self._points[rows["tactel"]]
        points["counts"], points["pressure"] = rows["counts"], pressure
        key = rows["cycle"].astype(np.int64) * len(self._links) + arm.tactel_link[rows["tactel"]]
        order = np.argsort(key, kind="stable")
        points, rows = points[order], rows[order]
        link = arm.tactel_link[rows["tactel"]]
        ends = [*(np.flatnonzero(np.diff(key[order])) + 1).tolist(), len(rows)]
        start, shown = 0, pressure[order]
        cycle_start = 0
        for end in ends:
            number = int(rows["cycle"][start])
            t_ns = times.get(number, int(rows["t_ns"][start]))
            name = self._links[link[start]]
            message = {
                "timestamp": time_of(t_ns),
                "frame_id": name,
                **self._cloud,
                "data": b64encode(points[start:end].tobytes()).decode(),
            }
            self._put(f"/pressures/{name}", schemas.POINT_CLOUD, t_ns, message)
            start = end
            if end == len(rows) or rows["cycle"][end] != number:
                here = slice(cycle_start, end)
                self._put(
                    "/readings", schemas.READINGS, t_ns, self._readings(number, t_ns, rows[here], shown[here])
                )
                cycle_start = end

    def _readings(self, number: int, t_ns: int, rows: npt.NDArray[Any], pressure: Any) -> dict[str, Any]:
        """Return the pressures of one cycle by patch, null where none is known; of two readings the last."""
        arm = self._arm
        pascals = np.full(arm.n_tactels, np.nan)
        pascals[rows["tactel"]] = pressure
        unknown = np.isnan(pascals)
        shown: list[Any] = np.rint(np.where(unknown, 0.0, pascals)).astype(np.int64).tolist()
        for k in np.flatnonzero(unknown).tolist():
            shown[k] = None
        starts = arm.patch_start.tolist()
        patches = [
            {
                "bus": arm.buses[placed.bus].name,
                "node_id": placed.node_id,
                "link": self._links[placed.link],
                "pressure_pa": shown[starts[p] : starts[p + 1]],
            }
            for p, placed in enumerate(arm.patches)
        ]
        return {"timestamp": time_of(t_ns), "cycle": number, "patches": patches}

    def add_contacts(self, source: str, groups: npt.NDArray[Any], rows: npt.NDArray[Any]) -> None:
        """Add the contacts (of LOGGED) of the cycles in ``groups``, of one source."""
        if not len(groups):
            return
        self._begin(int(groups["t_ns"][0]))
        starts = np.searchsorted(rows["group"], groups["group"], "left").tolist()
        ends = np.searchsorted(rows["group"], groups["group"], "right").tolist()
        times = groups["t_ns"].tolist()
        for group, t_ns, start, end in zip(groups, times, starts, ends, strict=True):
            here = rows[start:end]
            scene = contact_scene(here, self._links, t_ns, COLORS[source])
            self._put(f"/contacts/{source}", schemas.SCENE_UPDATE, t_ns, scene)
            values = {
                "timestamp": time_of(t_ns),
                "cycle": int(group["cycle"]),
                "sync_counter": int(group["sync"]),
                "contacts": [self._contact(int(row["t_ns"]), row["contact"]) for row in here],
            }
            self._put(f"/contacts/{source}/values", schemas.CONTACTS, t_ns, values)

    def close(self) -> None:
        """Finish the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _contact(self, t_ns: int, contact: Any) -> dict[str, Any]:
        is_known, has_place = contact["level"] < len(LEVELS), contact["link"] < len(self._links)
        return {
            "timestamp": time_of(t_ns),
            "id": int(contact["id"]),
            "identity": int(contact["identity"]) or None,
            "state": state_name(int(contact["state"])),
            "link": link_name(self._links, int(contact["link"])),
            "s_m": float(contact["s"]),
            "a_m": float(contact["a"]),
            "force_n": float(contact["force"]),
            "point_m": dict(zip("xyz", contact["point"].tolist(), strict=True)) if has_place else None,
            "normal": dict(zip("xyz", contact["normal"].tolist(), strict=True)) if has_place else None,
            "covariance": contact["covariance"].tolist() if contact["has_covariance"] else None,
            "quality": words_of(int(contact["quality"])) if is_known else None,
            "level": LEVELS[contact["level"]] if is_known else None,
        }

    def _begin(self, t_ns: int) -> None:
        """Write what stays, at the time of the first message."""
        if not self._has_begun:
            self._has_begun = True
            self._put("/tf", schemas.FRAME_TRANSFORMS, t_ns, transforms(self._arm, t_ns))
            self._put("/arm", schemas.SCENE_UPDATE, t_ns, arm_scene(self._arm, t_ns))

    def _put(self, topic: str, schema: schemas.Schema, t_ns: int, message: dict[str, Any]) -> None:
        if topic not in self._channels:
            name = schema["title"]
            if name not in self._schemas:
                self._schemas[name] = self._writer.register_schema(
                    name, "jsonschema", schemas.encoded(schema)
                )
            self._channels[topic] = self._writer.register_channel(topic, "json", self._schemas[name])
        sequence = self._n_messages[topic] = self._n_messages.get(topic, 0) + 1
        self._writer.add_message(
            self._channels[topic],
            log_time=t_ns,
            publish_time=t_ns,
            sequence=sequence,
            data=json.dumps(message, separators=(",", ":"), allow_nan=False).encode(),
        )
