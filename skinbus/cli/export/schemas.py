"""JSON schemas of the messages in an MCAP file: Foxglove's, as far as they are used, and skinbus's own.

Foxglove's are identified by their names; viewers read a message by the structure below.
Source: https://docs.foxglove.dev/docs/sdk/schemas.
"""

from __future__ import annotations

import json
from typing import Any, Final

Schema = dict[str, Any]


def _record(title: str, **properties: Schema) -> Schema:
    return {"type": "object", "title": title, "properties": properties, "required": list(properties)}


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


def _or_null(schema: Schema) -> Schema:
    return {"anyOf": [schema, {"type": "null"}]}


def _about(schema: Schema, description: str) -> Schema:
    return {**schema, "description": description}


_NUMBER: Final[Schema] = {"type": "number"}
_INTEGER: Final[Schema] = {"type": "integer"}
_TEXT: Final[Schema] = {"type": "string"}
_FLAG: Final[Schema] = {"type": "boolean"}
_NANOSECONDS: Final[Schema] = {"type": "integer", "minimum": 0, "maximum": 999_999_999}
_TIME: Final = _record("time", sec={"type": "integer", "minimum": 0}, nsec=_NANOSECONDS)
_DURATION: Final = _record("duration", sec=_INTEGER, nsec=_NANOSECONDS)
_VECTOR: Final = _record("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_POINT: Final = _record("foxglove.Point3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION: Final = _record("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE: Final = _record("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION)
_COLOR: Final = _record("foxglove.Color", r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_PAIR: Final = _record("foxglove.KeyValuePair", key=_TEXT, value=_TEXT)

_ARROW: Final = _record(
    "foxglove.ArrowPrimitive",
    pose=_POSE,
    shaft_length=_NUMBER,
    shaft_diameter=_NUMBER,
    head_length=_NUMBER,
    head_diameter=_NUMBER,
    color=_COLOR,
)
_CUBE: Final = _record("foxglove.CubePrimitive", pose=_POSE, size=_VECTOR, color=_COLOR)
_SPHERE: Final = _record("foxglove.SpherePrimitive", pose=_POSE, size=_VECTOR, color=_COLOR)
_CYLINDER: Final = _record(
    "foxglove.CylinderPrimitive",
    pose=_POSE,
    size=_VECTOR,
    bottom_scale=_NUMBER,
    top_scale=_NUMBER,
    color=_COLOR,
)
_LINE: Final = _record(
    "foxglove.LinePrimitive",
    type=_about(_INTEGER, "0 strip, 1 loop, 2 list"),
    pose=_POSE,
    thickness=_NUMBER,
    scale_invariant=_FLAG,
    points=_list(_POINT),
    color=_COLOR,
    colors=_list(_COLOR),
    indices=_list(_INTEGER),
)
_TRIANGLES: Final = _record(
    "foxglove.TriangleListPrimitive",
    pose=_POSE,
    points=_list(_POINT),
    color=_COLOR,
    colors=_list(_COLOR),
    indices=_list(_INTEGER),
)
_LABEL: Final = _record(
    "foxglove.TextPrimitive",
    pose=_POSE,
    billboard=_FLAG,
    font_size=_NUMBER,
    scale_invariant=_FLAG,
    color=_COLOR,
    text=_TEXT,
)
_MODEL: Final = _record(
    "foxglove.ModelPrimitive",
    pose=_POSE,
    scale=_VECTOR,
    color=_COLOR,
    override_color=_FLAG,
    url=_TEXT,
    media_type=_TEXT,
    data={"type": "string", "contentEncoding": "base64"},
)
_ENTITY: Final = _record(
    "foxglove.SceneEntity",
    timestamp=_TIME,
    frame_id=_TEXT,
    id=_TEXT,
    lifetime=_DURATION,
    frame_locked=_FLAG,
    metadata=_list(_PAIR),
    arrows=_list(_ARROW),
    cubes=_list(_CUBE),
    spheres=_list(_SPHERE),
    cylinders=_list(_CYLINDER),
    lines=_list(_LINE),
    triangles=_list(_TRIANGLES),
    texts=_list(_LABEL),
    models=_list(_MODEL),
)
_DELETION: Final = _record(
    "foxglove.SceneEntityDeletion",
    timestamp=_TIME,
    type=_about(_INTEGER, "0 matching id, 1 all"),
    id=_TEXT,
)
_FIELD: Final = _record(
    "foxglove.PackedElementField",
    name=_TEXT,
    offset=_INTEGER,
    type=_about(_INTEGER, "1 UINT8, 3 UINT16, 6 INT32, 7 FLOAT32"),
)
_TRANSFORM: Final = _record(
    "foxglove.FrameTransform",
    timestamp=_TIME,
    parent_frame_id=_TEXT,
    child_frame_id=_TEXT,
    translation=_VECTOR,
    rotation=_QUATERNION,
)

SCENE_UPDATE: Final = _record("foxglove.SceneUpdate", deletions=_list(_DELETION), entities=_list(_ENTITY))
POINT_CLOUD: Final = _record(
    "foxglove.PointCloud",
    timestamp=_TIME,
    frame_id=_TEXT,
    pose=_POSE,
    point_stride=_INTEGER,
    fields=_list(_FIELD),
    data={"type": "string", "contentEncoding": "base64"},
)
FRAME_TRANSFORMS: Final = _record("foxglove.FrameTransforms", transforms=_list(_TRANSFORM))

READINGS: Final = _record(
    "skinbus.Readings",
    timestamp=_TIME,
    cycle=_about(_INTEGER, "counted from 1 by the SYNCs of the recording"),
    patches=_list(
        _record(
            "skinbus.PatchReadings",
            bus=_TEXT,
            node_id=_INTEGER,
            link=_TEXT,
            pressure_pa=_about(
                _list(_or_null(_INTEGER)), "by tactel, rounded; the metadata record 'skinbus' says of what"
            ),
        )
    ),
)
CONTACTS: Final = _record(
    "skinbus.Contacts",
    timestamp=_TIME,
    cycle=_INTEGER,
    sync_counter=_INTEGER,
    contacts=_list(
        _record(
            "skinbus.Contact",
            timestamp=_TIME,
            id=_INTEGER,
            identity=_about(_or_null(_INTEGER), "null where it is not known: published"),
            state=_TEXT,
            link=_TEXT,
            s_m=_NUMBER,
            a_m=_NUMBER,
            force_n=_NUMBER,
            point_m=_about(_or_null(_VECTOR), "in the frame of the link"),
            normal=_or_null(_VECTOR),
            covariance=_about(_or_null(_list(_list(_NUMBER))), "of s, a (m) and force (N)"),
            quality=_or_null(_TEXT),
            level=_or_null(_TEXT),
        )
    ),
)


def encoded(schema: Schema) -> bytes:
    """Return a schema as it stands in the file."""
    text = {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
    return json.dumps(text, separators=(",", ":")).encode()
