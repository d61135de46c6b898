"""An arm and its contacts as messages of Foxglove: links, boards, arrows along the normals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.model import Arm, Link, PlacedPatch
from skinbus.skin.cycle import link_name

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

Message = dict[str, Any]

_IDENTITY: Final = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_LINK: Final = {"r": 0.55, "g": 0.57, "b": 0.6, "a": 0.6}
_BOARD: Final = {"r": 0.2, "g": 0.22, "b": 0.25, "a": 1.0}
COLORS: Final = {
    "published": {"r": 0.9, "g": 0.62, "b": 0.0, "a": 1.0},
    "recomputed": {"r": 0.0, "g": 0.45, "b": 0.7, "a": 1.0},
}
"""Of contacts by their source: orange and blue of Okabe and Ito's palette for colour-blind readers."""

_PRIMITIVES: Final = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")


def time_of(t_ns: int) -> Message:
    """Return a time as Foxglove has it."""
    return {"sec": t_ns // 1_000_000_000, "nsec": t_ns % 1_000_000_000}


def transforms(arm: Arm, t_ns: int) -> Message:
    """Return where the links are drawn."""
    found, x = [], 0.0
    for link in arm.links:
        found.append(
            {
                "timestamp": time_of(t_ns),
                "parent_frame_id": ROOT,
                "child_frame_id": link.name,
                "translation": {"x": x, "y": 0.0, "z": 0.0},
                "rotation": _IDENTITY,
            }
        )
        x += link.surface.length + GAP_M
    return {"transforms": found}


def arm_scene(arm: Arm, t_ns: int) -> Message:
    """Return the links with the outlines and node-IDs of their boards."""
    entities = []
    for k, link in enumerate(arm.links):
        shape = _surface(link)
        boards = [p for p, placed in enumerate(arm.patches) if placed.link == k]
        shape["lines"] = [_outline(link, arm.patches[p]) for p in boards]
        shape["texts"] = [_label(arm, p) for p in boards]
        entities.append(_entity(t_ns, link.name, f"link {link.name}", **shape))
    return {"deletions": [], "entities": entities}


def contact_scene(rows: npt.NDArray[Any], links: Sequence[str], t_ns: int, color: Message) -> Message:
    """Return the contacts of one cycle (of LOGGED) in place of those before; one on no link has no place."""
    entities = []
    for contact in rows["contact"]:
        if contact["link"] >= len(links):
            continue
        force = float(contact["force"])
        length = max(ARROW_M_PER_N * force, SHORTEST_M)
        head = min(0.4 * length, 6e-3)
        point, normal = contact["point"], contact["normal"]
        tail = point + length * normal
        arrow = {
            "pose": {"position": _vector(tail), "orientation": _turned(-normal)},
            "shaft_length": length - head,
            "shaft_diameter": 2e-3,
            "head_length": head,
            "head_diameter": 5e-3,
            "color": color,
        }
        text = {
            "pose": {"position": _vector(tail + 4e-3 * normal), "orientation": _IDENTITY},
            "billboard": True,
            "font_size": 12.0,
            "scale_invariant": True,
            "color": color,
            "text": f"#{int(contact['id'])} {force:.2f} N",
        }
        frame = link_name(links, int(contact["link"]))
        entities.append(_entity(t_ns, frame, f"contact {int(contact['id'])}", arrows=[arrow], texts=[text]))
    return {"deletions": [{"timestamp": time_of(t_ns), "type": 1, "id": ""}], "entities": entities}


def _entity(t_ns: int, frame: str, name: str, **primitives: list[Message]) -> Message:
    return {
        "timestamp": time_of(t_ns),
        "frame_id": frame,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
        "metadata": [],
        **{kind: [] for kind in _PRIMITIVES},
        **primitives,
    }


def _surface(link: Link) -> dict[str, list[Message]]:
    """Return the primitives of the surface of a link; of a kind without any its boards are shown."""
    surface = link.surface
    if surface.kind == "plane":
        size = {"x": surface.length, "y": surface.width, "z": 1e-3}
        center = {"x": 0.5 * surface.length, "y": 0.0, "z": -0.5e-3 - INSET_M}
        pose = {"position": center, "orientation": _IDENTITY}
        return {"cubes": [{"pose": pose, "size": size, "color": _LINK}]}
    if surface.kind not in ("cylinder", "cone"):
        return {}
    near, far = (float(surface.radius_at(s)) - INSET_M for s in (0.0, surface.length))
    widest, height = max(near, far), surface.length * math.sqrt(1.0 - surface.taper**2)
    # the cylinder's own axis is z, which a quarter turn about y brings to x
    turned = {"x": 0.0, "y": math.sqrt(0.5), "z": 0.0, "w": math.sqrt(0.5)}
    cylinder = {
        "pose": {"position": {"x": 0.5 * height, "y": 0.0, "z": 0.0}, "orientation": turned},
        "size": {"x": 2.0 * widest, "y": 2.0 * widest, "z": height},
        "bottom_scale": near / widest,
        "top_scale": far / widest,
        "color": _LINK,
    }
    return {"cylinders": [cylinder]}


def _outline(link: Link, placed: PlacedPatch) -> Message:
    u, v = 0.5 * np.array(placed.patch.size)
    t = np.linspace(-1.0, 1.0, 9)[:-1]  # a side of a board that is bent round the link
    ones = np.ones_like(t)
    uv = np.concatenate([np.stack(side, -1) for side in ((t, -ones), (ones, t), (-t, ones), (-ones, -t))])
    points = _places(link, placed, uv * (u, v))
    return {
        "type": 1,
        "pose": {"position": _vector(np.zeros(3)), "orientation": _IDENTITY},
        "thickness": 1.5,
        "scale_invariant": True,
        "points": [_vector(point) for point in points],
        "color": _BOARD,
        "colors": [],
        "indices": [],
    }


def _label(arm: Arm, p: int) -> Message:
    placed = arm.patches[p]
    corner = _places(arm.links[placed.link], placed, np.array([[0.0, -0.5 * placed.patch.size[1]]]))[0]
    return {
        "pose": {"position": _vector(corner), "orientation": _IDENTITY},
        "billboard": True,
        "font_size": 10.0,
        "scale_invariant": True,
        "color": _BOARD,
        "text": arm.node_label(p),
    }


def _places(link: Link, placed: PlacedPatch, uv: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return points of a board (n, 2) in the frame of its link, (n, 3) m."""
    return link.surface.position(*placed.on_link(link.surface, uv))[0]


def _vector(point: npt.NDArray[np.float64]) -> Message:
    x, y, z = point.tolist()
    return {"x": x, "y": y, "z": z}


def _turned(direction: npt.NDArray[np.float64]) -> Message:
    """Return the shortest rotation from +x to a unit vector."""
    x, y, z = direction.tolist()
    if x < -1.0 + 1e-12:
        return {"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0}
    scale = 1.0 / math.hypot(1.0 + x, y, z)
    return {"x": 0.0, "y": -z * scale, "z": y * scale, "w": (1.0 + x) * scale}
