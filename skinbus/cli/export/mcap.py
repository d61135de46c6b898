"""A recording as MCAP in Foxglove's schemas, for Foxglove and Lichtblick.

======================== ========================= ==========================================
topic                    schema                    contents
======================== ========================= ==========================================
/tf                      foxglove.FrameTransforms  the links in a row, once
/arm                     foxglove.SceneUpdate      links and boards, once
/pressures/LINK          foxglove.PointCloud       counts and pressures of a link, each cycle
/readings                skinbus.Readings          pressures by patch in whole Pa, to plot
/contacts/SOURCE         foxglove.SceneUpdate      arrows, each cycle
/contacts/SOURCE/values  skinbus.Contacts          the same as numbers
======================== ========================= ==========================================

SOURCE is ``published`` (the master in the log) or ``recomputed``.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import foxglove
import numpy as np
import numpy.typing as npt
from foxglove.channels import FrameTransformsChannel, PointCloudChannel, SceneUpdateChannel
from foxglove.messages import (
    ArrowPrimitive,
    Color,
    CubePrimitive,
    CylinderPrimitive,
    FrameTransform,
    FrameTransforms,
    LinePrimitive,
    LinePrimitiveLineType,
    PackedElementField,
    PackedElementFieldNumericType,
    Point3,
    PointCloud,
    Pose,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    TextPrimitive,
    Timestamp,
    Vector3,
)

from skinbus.cli.export.rows import LogPart, level_of, quality_of, state_name
from skinbus.model import Arm
from skinbus.skin.cycle import link_name

POINT: Final = np.dtype(
    [
        *((axis, "<f4") for axis in "xyz"),
        ("pressure", "<f4"),
        ("counts", "<i4"),
        ("node_id", "u1"),
        ("tactel", "u1"),
        ("bus", "u1"),
    ]
)
"""A tactel in a point cloud: m in the frame of the link, Pa, counts."""
TYPES: Final = {
    "u1": PackedElementFieldNumericType.Uint8,
    "i4": PackedElementFieldNumericType.Int32,
    "f4": PackedElementFieldNumericType.Float32,
}
FIELDS: Final = [
    PackedElementField(name=name, offset=offset, type=TYPES[dtype.str[1:]])
    for name, (dtype, offset, *_) in (POINT.fields or {}).items()
]

ROOT: Final = "links_side_by_side"
"""Frame of all links: a recording has no joint positions, so they lie in a row, not as on the robot."""
GAP_M: Final = 0.1
"""Between two links in the row."""
INSET_M: Final = 0.5e-3
"""How far the drawn surface of a link is below the tactels, which it would hide."""
ARROW_M_PER_N: Final = 5e-3
"""10 N are as long as a board."""
SHORTEST_M: Final = 4e-3
"""Of an arrow: a light contact is seen too."""
LINK: Final = Color(r=0.55, g=0.57, b=0.6, a=0.6)
BOARD: Final = Color(r=0.2, g=0.22, b=0.25, a=1.0)
COLORS: Final = {
    "published": Color(r=0.9, g=0.62, b=0.0, a=1.0),
    "recomputed": Color(r=0.0, g=0.45, b=0.7, a=1.0),
}
"""Orange and blue of Okabe and Ito's palette for colour-blind readers."""


class McapFile:
    """Writes messages, part by part."""

    def __init__(self, file: Path, arm: Arm, about: dict[str, str]) -> None:
        self._arm, self._links = arm, [link.name for link in arm.links]
        self._context = foxglove.Context()
        self._writer = foxglove.open_mcap(file, allow_overwrite=True, context=self._context)
        self._writer.write_metadata("skinbus", about)
        self._channels: dict[str, Any] = {}
        self._points = np.zeros(arm.n_tactels, POINT)
        for k, link in enumerate(arm.links):
            here = arm.tactel_link == k
            place, _ = link.surface.position(arm.tactel_s[here], arm.tactel_a[here])
            for column, axis in enumerate("xyz"):
                self._points[axis][here] = place[:, column]
        self._points["node_id"] = arm.node_id[arm.tactel_patch]
        self._points["bus"] = arm.patch_bus[arm.tactel_patch]
        self._points["tactel"] = np.arange(arm.n_tactels) - arm.patch_start[arm.tactel_patch] + 1

    def add(
        self,
        part: LogPart,
        pressure: npt.NDArray[np.float64],
        zeroed: npt.NDArray[np.float32] | None,
        recomputed: npt.NDArray[Any] | None,
    ) -> None:
        """Add a part with its pressures, Pa, and what a master makes of it, None for none."""
        shown = pressure if zeroed is None else zeroed
        for number, t_ns in part.begun.tolist():
            if "/arm" not in self._channels:
                self._put("/tf", FrameTransformsChannel, t_ns, self._transforms())
                self._put("/arm", SceneUpdateChannel, t_ns, self._scene(t_ns))
            low, high = np.searchsorted(part.readings["cycle"], [number, number + 1])
            self._put_readings(number, t_ns, part.readings[low:high], shown[low:high])
            for source, rows in (("published", part.contacts), ("recomputed", recomputed)):
                if rows is not None:
                    low, high = np.searchsorted(rows["cycle"], [number, number + 1])
                    self._put_contacts(source, number, t_ns, rows[low:high])

    def close(self) -> None:
        """Finish the file."""
        self._writer.close()

    def _put(self, topic: str, kind: Any, t_ns: int, message: Any) -> None:
        if topic not in self._channels:
            self._channels[topic] = kind(topic, context=self._context)
        self._channels[topic].log(message, log_time=t_ns)

    def _put_json(self, topic: str, title: str, t_ns: int, message: dict[str, Any]) -> None:
        def channel(topic: str, context: Any) -> Any:
            schema = {"title": title, "type": "object", "properties": {}}
            return foxglove.Channel(topic, schema=schema, context=context)

        time = {"sec": t_ns // 1_000_000_000, "nsec": t_ns % 1_000_000_000}
        self._put(topic, channel, t_ns, {"timestamp": time, **message})

    def _put_readings(self, number: int, t_ns: int, rows: npt.NDArray[Any], pressure: Any) -> None:
        """Put the point clouds of a cycle, and its pressures by patch: of two readings the last."""
        arm = self._arm
        points = self._points[rows["tactel"]]
        points["counts"], points["pressure"] = rows["counts"], pressure
        link = arm.tactel_link[rows["tactel"]]
        for k in np.unique(link).tolist():
            cloud = PointCloud(
                timestamp=_time(t_ns),
                frame_id=self._links[k],
                pose=_pose(np.zeros(3)),
                point_stride=POINT.itemsize,
                fields=FIELDS,
                data=points[link == k].tobytes(),
            )
            self._put(f"/pressures/{self._links[k]}", PointCloudChannel, t_ns, cloud)
        pascals = np.full(arm.n_tactels, np.nan)
        pascals[rows["tactel"]] = pressure
        shown = [None if math.isnan(p) else round(p) for p in pascals.tolist()]
        patches = [
            {
                "bus": arm.buses[placed.bus].name,
                "node_id": placed.node_id,
                "link": self._links[placed.link],
                "pressure_pa": shown[arm.tactels_of(p)],
            }
            for p, placed in enumerate(arm.patches)
        ]
        self._put_json("/readings", "skinbus.Readings", t_ns, {"cycle": number, "patches": patches})

    def _put_contacts(self, source: str, number: int, t_ns: int, rows: npt.NDArray[Any]) -> None:
        """Put the contacts of a cycle (of LOGGED); one on no link has no place."""
        entities, values, color = [], [], COLORS[source]
        for row in rows:
            contact, name = row["contact"], link_name(self._links, int(row["contact"]["link"]))
            has_place, force = contact["link"] < len(self._links), float(contact["force"])
            point, normal = contact["point"], contact["normal"]
            values.append(
                {
                    "t_ns": int(row["t_ns"]),
                    "id": int(contact["id"]),
                    "identity": int(contact["identity"]) or None,
                    "state": state_name(contact["state"]),
                    "link": name,
                    "s_m": float(contact["s"]),
                    "a_m": float(contact["a"]),
                    "force_n": force,
                    "point_m": dict(zip("xyz", point.tolist(), strict=True)) if has_place else None,
                    "normal": dict(zip("xyz", normal.tolist(), strict=True)) if has_place else None,
                    "covariance": contact["covariance"].tolist() if contact["has_covariance"] else None,
                    "quality": quality_of(contact),
                    "level": level_of(contact),
                }
            )
            if not has_place:
                continue
            length = max(ARROW_M_PER_N * force, SHORTEST_M)
            head, tail = min(0.4 * length, 6e-3), point + length * normal
            arrow = ArrowPrimitive(
                pose=_pose(tail, _turned(-normal)),
                shaft_length=length - head,
                shaft_diameter=2e-3,
                head_length=head,
                head_diameter=5e-3,
                color=color,
            )
            text = _text(tail + 4e-3 * normal, f"#{int(contact['id'])} {force:.2f} N", color)
            entity = _entity(t_ns, name, f"contact {int(contact['id'])}", arrows=[arrow], texts=[text])
            entities.append(entity)
        before = SceneEntityDeletion(timestamp=_time(t_ns), type=SceneEntityDeletionType.All, id="")
        scene = SceneUpdate(deletions=[before], entities=entities)
        self._put(f"/contacts/{source}", SceneUpdateChannel, t_ns, scene)
        numbers = {"cycle": number, "contacts": values}
        self._put_json(f"/contacts/{source}/values", "skinbus.Contacts", t_ns, numbers)

    def _transforms(self) -> FrameTransforms:
        """Return where the links are drawn."""
        found, x = [], 0.0
        for link in self._arm.links:
            place = Vector3(x=x, y=0.0, z=0.0)
            found.append(
                FrameTransform(
                    parent_frame_id=ROOT,
                    child_frame_id=link.name,
                    translation=place,
                    rotation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
                )
            )
            x += link.surface.length + GAP_M
        return FrameTransforms(transforms=found)

    def _scene(self, t_ns: int) -> SceneUpdate:
        """Return the links with the outlines and node-IDs of their boards."""
        entities = []
        side = np.linspace(-1.0, 1.0, 9)[:-1]  # of a board that is bent round the link
        one = np.ones_like(side)
        edges = ((side, -one), (one, side), (-side, one), (-one, -side))
        outline = np.concatenate([np.stack(edge, -1) for edge in edges])
        for k, link in enumerate(self._arm.links):
            lines, texts = [], []
            for p, placed in enumerate(self._arm.patches):
                if placed.link != k:
                    continue
                uv = 0.5 * np.array(placed.patch.size) * np.vstack([outline, [0.0, -1.0]])
                points, _ = link.surface.position(*placed.on_link(link.surface, uv))
                lines.append(
                    LinePrimitive(
                        type=LinePrimitiveLineType.LineLoop,
                        pose=_pose(np.zeros(3)),
                        thickness=1.5,
                        scale_invariant=True,
                        points=[Point3(x=x, y=y, z=z) for x, y, z in points[:-1].tolist()],
                        color=BOARD,
                    )
                )
                texts.append(_text(points[-1], self._arm.node_label(p), BOARD))
            entities.append(
                _entity(
                    t_ns, link.name, f"link {link.name}", lines=lines, texts=texts, **_surface(link.surface)
                )
            )
        return SceneUpdate(entities=entities)


def _entity(t_ns: int, frame: str, name: str, **primitives: Any) -> SceneEntity:
    return SceneEntity(timestamp=_time(t_ns), frame_id=frame, id=name, frame_locked=True, **primitives)


def _surface(surface: Any) -> dict[str, Any]:
    """Return the primitives of the surface of a link; of a kind without any its boards are shown."""
    if surface.kind == "plane":
        center = np.array([0.5 * surface.length, 0.0, -0.5e-3 - INSET_M])
        size = Vector3(x=surface.length, y=surface.width, z=1e-3)
        return {"cubes": [CubePrimitive(pose=_pose(center), size=size, color=LINK)]}
    if surface.kind not in ("cylinder", "cone"):
        return {}
    near, far = (float(surface.radius_at(s)) - INSET_M for s in (0.0, surface.length))
    widest, height = max(near, far), surface.length * math.sqrt(1.0 - surface.taper**2)
    cylinder = CylinderPrimitive(
        # the cylinder's own axis is z, which a quarter turn about y brings to x
        pose=_pose(np.array([0.5 * height, 0.0, 0.0]), (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))),
        size=Vector3(x=2.0 * widest, y=2.0 * widest, z=height),
        bottom_scale=near / widest,
        top_scale=far / widest,
        color=LINK,
    )
    return {"cylinders": [cylinder]}


def _text(point: npt.NDArray[Any], text: str, color: Color) -> TextPrimitive:
    return TextPrimitive(
        pose=_pose(point), billboard=True, font_size=11.0, scale_invariant=True, color=color, text=text
    )


def _pose(point: npt.NDArray[Any], turn: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)) -> Pose:
    x, y, z = point.tolist()
    return Pose(
        position=Vector3(x=x, y=y, z=z), orientation=Quaternion(x=turn[0], y=turn[1], z=turn[2], w=turn[3])
    )


def _turned(direction: npt.NDArray[Any]) -> tuple[float, ...]:
    """Return the shortest rotation from +x to a unit vector."""
    x, y, z = direction.tolist()
    if x < -1.0 + 1e-12:
        return 0.0, 0.0, 1.0, 0.0
    scale = 1.0 / math.hypot(1.0 + x, y, z)
    return 0.0, -z * scale, y * scale, (1.0 + x) * scale


def _time(t_ns: int) -> Timestamp:
    return Timestamp(sec=t_ns // 1_000_000_000, nsec=t_ns % 1_000_000_000)
