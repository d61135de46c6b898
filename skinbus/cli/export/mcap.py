"""A recording as MCAP in Foxglove's schemas, for Foxglove and Lichtblick.

================ ======================== ==========================================
topic            schema                   contents
================ ======================== ==========================================
/tf              foxglove.FrameTransforms the links in a row, once
/pressures/LINK  foxglove.PointCloud      counts and pressures of a link, each cycle
/contacts        foxglove.SceneUpdate     arrows, each cycle
/contacts/values skinbus.Contacts         the same as numbers
================ ======================== ==========================================
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, Final

import foxglove
import numpy as np
import numpy.typing as npt
from foxglove.channels import FrameTransformsChannel, PointCloudChannel, SceneUpdateChannel
from foxglove.messages import (
    ArrowPrimitive,
    Color,
    FrameTransform,
    FrameTransforms,
    PackedElementField,
    PackedElementFieldNumericType,
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

from skinbus.cli.recorded import RecordedCycle, values_of
from skinbus.model import Arm
from skinbus.skin.contact import Contact

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
ARROW_M_PER_N: Final = 5e-3
"""10 N are as long as a board."""
HEAD_M: Final = 2e-3
"""Of an arrow: a light contact is seen too."""
COLOR: Final = Color(r=0.9, g=0.62, b=0.0, a=1.0)
"""Orange of Okabe and Ito's palette for colour-blind readers."""
CONTACTS: Final = {"title": "skinbus.Contacts", "type": "object", "properties": {}}
NO_TURN: Final = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)


class Writer:
    """Writes messages."""

    def __init__(self, file: Path, arm: Arm, about: dict[str, str]) -> None:
        self._arm, self._links = arm, [link.name for link in arm.links]
        self._context = foxglove.Context()
        self._writer = foxglove.open_mcap(file, allow_overwrite=True, context=self._context)
        self._writer.write_metadata("skinbus", about)
        self._channels: dict[str, Any] = {}
        self._places = np.zeros((arm.n_tactels, 3))
        for k, link in enumerate(arm.links):
            here = arm.tactel_link == k
            self._places[here], _ = link.surface.position(arm.tactel_s[here], arm.tactel_a[here])

    def add(self, cycle: RecordedCycle) -> None:
        """Add a cycle."""
        if not self._channels:
            self._put("/tf", FrameTransformsChannel, cycle.t_ns, self._transforms())
        self._put_readings(cycle)
        self._put_contacts(cycle)

    def close(self) -> None:
        """Finish the file."""
        self._writer.close()

    def _put(self, topic: str, kind: Any, t_ns: int, message: Any) -> None:
        if topic not in self._channels:
            self._channels[topic] = kind(topic, context=self._context)
        self._channels[topic].log(message, log_time=t_ns)

    def _put_readings(self, cycle: RecordedCycle) -> None:
        """Put a point cloud for each link."""
        rows = cycle.readings
        points = np.zeros(len(rows), POINT)
        for name in ("counts", "node_id", "tactel", "bus"):
            points[name] = rows[name]
        points["x"], points["y"], points["z"] = self._places[cycle.tactels].T
        points["pressure"] = rows["zeroed_pa"]
        for k in np.unique(rows["link"]).tolist():
            cloud = PointCloud(
                timestamp=_time(cycle.t_ns),
                frame_id=self._links[k],
                pose=_pose(np.zeros(3)),
                point_stride=POINT.itemsize,
                fields=FIELDS,
                data=points[rows["link"] == k].tobytes(),
            )
            self._put(f"/pressures/{self._links[k]}", PointCloudChannel, cycle.t_ns, cloud)

    def _put_contacts(self, cycle: RecordedCycle) -> None:
        """Put the contacts, as arrows and as numbers."""
        before = SceneEntityDeletion(timestamp=_time(cycle.t_ns), type=SceneEntityDeletionType.All, id="")
        scene = SceneUpdate(deletions=[before], entities=[*map(_arrow, cycle.contacts)])
        self._put("/contacts", SceneUpdateChannel, cycle.t_ns, scene)
        values = {"cycle": cycle.number, "contacts": [*map(values_of, cycle.contacts)]}
        self._put("/contacts/values", partial(foxglove.Channel, schema=CONTACTS), cycle.t_ns, values)

    def _transforms(self) -> FrameTransforms:
        """Return where the links are drawn."""
        ends = np.cumsum([0.0, *(link.surface.length + GAP_M for link in self._arm.links)])
        return FrameTransforms(
            transforms=[
                FrameTransform(
                    parent_frame_id=ROOT,
                    child_frame_id=name,
                    translation=Vector3(x=x, y=0.0, z=0.0),
                    rotation=NO_TURN,
                )
                for name, x in zip(self._links, ends.tolist(), strict=False)
            ]
        )


def _arrow(contact: Contact) -> SceneEntity:
    """Return an arrow that presses on the place of a contact, with its force."""
    shaft, name = ARROW_M_PER_N * contact.force, f"contact {contact.id}"
    tail = contact.point + (shaft + HEAD_M) * contact.normal
    arrow = ArrowPrimitive(
        pose=_pose(tail, _turn_to(-contact.normal)),
        shaft_length=shaft,
        shaft_diameter=2e-3,
        head_length=HEAD_M,
        head_diameter=5e-3,
        color=COLOR,
    )
    label = TextPrimitive(
        pose=_pose(tail), billboard=True, font_size=11.0, scale_invariant=True, color=COLOR,
        text=f"#{contact.id} {contact.force:.2f} N",
    )  # fmt: skip
    return SceneEntity(frame_id=contact.link, id=name, frame_locked=True, arrows=[arrow], texts=[label])


def _pose(point: npt.NDArray[Any], turn: Quaternion = NO_TURN) -> Pose:
    x, y, z = point.tolist()
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=turn)


def _turn_to(direction: npt.NDArray[Any]) -> Quaternion:
    """Return the shortest rotation from +x to a unit vector."""
    x, y, z = direction.tolist()
    if x < -1.0 + 1e-12:
        return Quaternion(x=0.0, y=0.0, z=1.0, w=0.0)
    scale = 1.0 / np.hypot(1.0 + x, np.hypot(y, z))
    return Quaternion(x=0.0, y=-z * scale, z=y * scale, w=(1.0 + x) * scale)


def _time(t_ns: int) -> Timestamp:
    return Timestamp(sec=t_ns // 1_000_000_000, nsec=t_ns % 1_000_000_000)
