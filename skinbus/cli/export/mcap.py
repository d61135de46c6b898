"""A recording as MCAP in Foxglove's schemas, for Foxglove and Lichtblick.

================ ======================= =================================
topic            schema                  contents
================ ======================= =================================
/pressures       foxglove.PointCloud     readings, each cycle
/contacts        foxglove.SceneUpdate    lines, each cycle
/contacts/values skinbus.Contacts        the same as numbers
================ ======================= =================================
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import foxglove
import numpy as np
from foxglove.channels import PointCloudChannel, SceneUpdateChannel
from foxglove.messages import (
    Color,
    LinePrimitive,
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
    Timestamp,
    Vector3,
)

from skinbus.cli.recorded import READING, RecordedCycle, values_of
from skinbus.model import Arm
from skinbus.skin.contact import Contact

TYPES = {
    "u1": PackedElementFieldNumericType.Uint8,
    "i4": PackedElementFieldNumericType.Int32,
    "f4": PackedElementFieldNumericType.Float32,
    "f8": PackedElementFieldNumericType.Float64,
}
FIELDS = [
    PackedElementField(name=name, offset=offset, type=TYPES[dtype.str[1:]])
    for name, (dtype, offset, *_) in (READING.fields or {}).items()
    if dtype.str[1:] in TYPES  # there are no integers of 64 bits
]
FRAME = "links_side_by_side"
"""A recording has no joint positions: the links lie in a row along x, not as on the robot."""
GAP_M = 0.1
"""Between two links in the row."""
M_PER_N = 5e-3
"""10 N are as long as a board."""
THICKNESS_M = 3e-3
COLOR = Color(r=0.9, g=0.62, b=0.0, a=1.0)
"""Orange of Okabe and Ito's palette for colour-blind readers."""
CONTACTS = {"title": "skinbus.Contacts", "type": "object", "properties": {}}
POSE = Pose(position=Vector3(x=0.0, y=0.0, z=0.0), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0))


def write(cycles: Iterable[RecordedCycle], file: Path, arm: Arm, about: dict[str, str]) -> None:
    """Write a file."""
    context = foxglove.Context()
    clouds = PointCloudChannel("/pressures", context=context)
    lines = SceneUpdateChannel("/contacts", context=context)
    values = foxglove.Channel("/contacts/values", schema=CONTACTS, context=context)
    begins = np.cumsum([0.0, *(link.surface.length + GAP_M for link in arm.links)])
    begin_of = {link.name: begin for link, begin in zip(arm.links, begins.tolist(), strict=False)}
    with foxglove.open_mcap(file, allow_overwrite=True, context=context) as writer:
        writer.write_metadata("skinbus", about)
        for cycle, t_ns, readings in cycles:
            stamp = Timestamp(sec=t_ns // 1_000_000_000, nsec=t_ns % 1_000_000_000)
            readings["x"] += begins[readings["link"]]
            cloud = PointCloud(
                timestamp=stamp,
                frame_id=FRAME,
                pose=POSE,
                point_stride=READING.itemsize,
                fields=FIELDS,
                data=readings.tobytes(),
            )
            clouds.log(cloud, log_time=t_ns)
            before = SceneEntityDeletion(timestamp=stamp, type=SceneEntityDeletionType.All, id="")
            entities = [_line(contact, begin_of[contact.link]) for contact in cycle.contacts]
            lines.log(SceneUpdate(deletions=[before], entities=entities), log_time=t_ns)
            contacts = [*map(values_of, cycle.contacts)]
            values.log({"cycle": cycle.number, "contacts": contacts}, log_time=t_ns)


def _line(contact: Contact, begin: float) -> SceneEntity:
    """Return a line along the normal, as long as its force says; its link begins at x."""
    foot = contact.point + np.array([begin, 0.0, 0.0])
    ends = foot, foot + M_PER_N * contact.force * contact.normal
    line = LinePrimitive(
        pose=POSE,
        thickness=THICKNESS_M,
        color=COLOR,
        points=[Point3(x=x, y=y, z=z) for x, y, z in (end.tolist() for end in ends)],
    )
    return SceneEntity(frame_id=FRAME, id=f"contact {contact.id}", lines=[line])
