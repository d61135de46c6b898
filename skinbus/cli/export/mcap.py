"""A recording as MCAP in Foxglove's schemas, for Foxglove and Lichtblick.

================ ======================== ==========================================
topic            schema                   contents
================ ======================== ==========================================
/tf              foxglove.FrameTransforms the links in a row, once
/pressures/LINK  foxglove.PointCloud      readings of a link, each cycle
/contacts        foxglove.SceneUpdate     arrows, each cycle
/contacts/values skinbus.Contacts         the same as numbers
================ ======================== ==========================================
"""

from __future__ import annotations

from collections.abc import Iterable
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
    Timestamp,
    Vector3,
)

from skinbus.cli.recorded import READING, RecordedCycle, values_of
from skinbus.model import Arm
from skinbus.skin.contact import Contact

TYPES: Final = {
    "u1": PackedElementFieldNumericType.Uint8,
    "i4": PackedElementFieldNumericType.Int32,
    "f4": PackedElementFieldNumericType.Float32,
    "f8": PackedElementFieldNumericType.Float64,
}
FIELDS: Final = [
    PackedElementField(name=name, offset=offset, type=TYPES[dtype.str[1:]])
    for name, (dtype, offset, *_) in (READING.fields or {}).items()
    if dtype.str[1:] in TYPES  # there are no integers of 64 bits
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


def write(cycles: Iterable[RecordedCycle], file: Path, arm: Arm, about: dict[str, str]) -> None:
    """Write a file."""
    context = foxglove.Context()
    frames = FrameTransformsChannel("/tf", context=context)
    clouds = [PointCloudChannel(f"/pressures/{link.name}", context=context) for link in arm.links]
    arrows = SceneUpdateChannel("/contacts", context=context)
    values = foxglove.Channel("/contacts/values", schema=CONTACTS, context=context)
    with foxglove.open_mcap(file, allow_overwrite=True, context=context) as writer:
        writer.write_metadata("skinbus", about)
        for number, (cycle, t_ns, readings) in enumerate(cycles):
            stamp = Timestamp(sec=t_ns // 1_000_000_000, nsec=t_ns % 1_000_000_000)
            if not number:
                frames.log(_links_in_a_row(arm), log_time=t_ns)
            for k in np.unique(readings["link"]).tolist():
                cloud = PointCloud(
                    timestamp=stamp,
                    frame_id=arm.links[k].name,
                    pose=_pose(np.zeros(3)),
                    point_stride=READING.itemsize,
                    fields=FIELDS,
                    data=readings[readings["link"] == k].tobytes(),
                )
                clouds[k].log(cloud, log_time=t_ns)
            before = SceneEntityDeletion(timestamp=stamp, type=SceneEntityDeletionType.All, id="")
            scene = SceneUpdate(deletions=[before], entities=[*map(_arrow, cycle.contacts)])
            arrows.log(scene, log_time=t_ns)
            contacts = [*map(values_of, cycle.contacts)]
            values.log({"cycle": cycle.number, "contacts": contacts}, log_time=t_ns)


def _links_in_a_row(arm: Arm) -> FrameTransforms:
    """Return where the links are drawn."""
    ends = np.cumsum([0.0, *(link.surface.length + GAP_M for link in arm.links)])
    return FrameTransforms(
        transforms=[
            FrameTransform(
                parent_frame_id=ROOT,
                child_frame_id=link.name,
                translation=Vector3(x=x, y=0.0, z=0.0),
                rotation=NO_TURN,
            )
            for link, x in zip(arm.links, ends.tolist(), strict=False)
        ]
    )


def _arrow(contact: Contact) -> SceneEntity:
    """Return an arrow that presses on the place of a contact, with its force."""
    shaft = ARROW_M_PER_N * contact.force
    tail = contact.point + (shaft + HEAD_M) * contact.normal
    arrow = ArrowPrimitive(
        pose=_pose(tail, _turn_to(-contact.normal)),
        shaft_length=shaft,
        shaft_diameter=2e-3,
        head_length=HEAD_M,
        head_diameter=5e-3,
        color=COLOR,
    )
    return SceneEntity(frame_id=contact.link, id=f"contact {contact.id}", frame_locked=True, arrows=[arrow])


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
