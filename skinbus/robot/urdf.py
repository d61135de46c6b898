"""URDF files: read by yourdfpy, checked before so that every fault is reported with its line and element.

What skins need is read: links and the joints between them. Inertias, shapes and transmissions are not.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.errors import ConfigError, Fault, FaultList, SkinbusError
from skinbus.file_bytes import read_bytes

Floats = npt.NDArray[np.float64]

MOST_BYTES: Final = 20_000_000
KINDS: Final = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
MOVING: Final = ("revolute", "continuous", "prismatic", "planar")
"""Kinds with an axis."""
NUMBERS: Final = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "dynamics": {"damping": 1, "friction": 1},
    "calibration": {"rising": 1, "falling": 1},
    "safety_controller": {"soft_lower_limit": 1, "soft_upper_limit": 1, "k_position": 1, "k_velocity": 1},
    "mass": {"value": 1},
    "inertia": {"ixx": 1, "ixy": 1, "ixz": 1, "iyy": 1, "iyz": 1, "izz": 1},
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "mesh": {"scale": 3},
    "color": {"rgba": 4},
}
"""How many numbers an attribute holds, by element: those that yourdfpy turns into numbers."""
_WISHES: Final = {1: "a finite number", 3: "three finite numbers", 4: "four finite numbers"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joint:
    """A joint; ``X_PJ`` (4, 4) is its frame at position 0 in its parent link, ``axis`` a unit vector."""

    name: str
    kind: str
    parent: str
    child: str
    X_PJ: Floats
    axis: Floats
    mimics: str | None
    lower: float
    upper: float
    velocity: float
    """Limit as in the URDF, rad/s or m/s; infinite where it has none, or 0."""


def read_urdf(path: str | Path) -> tuple[str, list[Joint]]:
    """Return the root link of a URDF and its joints in the order of the tree, parents first.

    Raises:
        ConfigError: it cannot be read, or has faults: all of them.
        SkinbusError: yourdfpy is not installed.
    """
    try:
        from yourdfpy import URDF
    except ImportError as error:
        raise SkinbusError(
            f"a robot needs yourdfpy ({error.name} is missing): pip install 'skinbus[robot]'"
        ) from error

    import lxml.etree as xml

    content = read_bytes(Path(path), MOST_BYTES)
    try:
        root = xml.fromstring(content, xml.XMLParser(remove_comments=True, resolve_entities=False))
    except xml.XMLSyntaxError as error:
        fault = Fault(f"line {error.lineno}", None, f"XML: {error.msg}")
        raise ConfigError(str(path), [fault]) from None
    if faults := FaultList(_faults(root)):
        raise ConfigError(str(path), faults)
    try:
        # neither the shapes nor yourdfpy's own kinematics are wanted: they take most of its time
        robot = URDF.load(BytesIO(content), build_scene_graph=False, load_meshes=False).robot
    except Exception as error:
        wanted = f"a URDF that yourdfpy can read ({type(error).__name__}: {error})"
        raise ConfigError(str(path), [Fault("file", None, wanted)]) from error
    from_link: defaultdict[str, list[Joint]] = defaultdict(list)
    for joint in robot.joints:
        limit = joint.limit
        from_link[joint.parent].append(
            Joint(
                name=joint.name,
                kind=joint.type,
                parent=joint.parent,
                child=joint.child,
                X_PJ=np.eye(4) if joint.origin is None else np.asarray(joint.origin, float),
                axis=_unit(joint.axis),
                mimics=None if joint.mimic is None else str(joint.mimic.joint),
                lower=-np.inf if limit is None or limit.lower is None else float(limit.lower),
                upper=np.inf if limit is None or limit.upper is None else float(limit.upper),
                velocity=np.inf if limit is None or not limit.velocity else abs(float(limit.velocity)),
            )
        )
    carried = {joint.child for joint in robot.joints}
    base = next((link.name for link in robot.links if link.name not in carried), "")
    ordered = list(from_link[base])
    for joint in ordered:  # grows while it is walked
        ordered += from_link[joint.child]
    if loop := carried - {joint.child for joint in ordered}:
        raise ConfigError(str(path), [Fault(_at(root), max(loop), "links without a loop of joints")])
    return base, ordered


def _unit(axis: Any) -> Floats:
    axis = np.asarray(axis, float)
    length = float(np.linalg.norm(axis))
    return axis / length if length else np.array([1.0, 0.0, 0.0])


def _at(element: Any, key: str = "") -> str:
    """Return where an element is, for messages."""
    name = element.get("name")
    tag = f"<{element.tag}>" if name is None else f"<{element.tag} {name}>"
    return f"line {element.sourceline} {tag}{' ' if key else ''}{key}"


def _faults(root: Any) -> Iterator[Fault]:
    """Yield every fault of a URDF that would be read wrongly, or not at all."""
    if root.tag != "robot":
        yield Fault(_at(root), None, "<robot>, the element around a URDF")
        return
    links, joints = root.findall("link"), root.findall("joint")
    if not links:
        yield Fault(_at(root), None, "at least one <link>")
    for elements in (links, joints):
        seen: set[str] = set()
        for element in elements:
            name = element.get("name")
            if not name:
                yield Fault(_at(element), name, "a name")
            elif name in seen:
                yield Fault(_at(element, "name"), name, "a name that no other has")
            seen.add(name)
    for owner in (*links, *joints, *root.findall("material")):
        yield from _number_faults(owner)
    names = {link.get("name") for link in links}
    child_of: dict[str, str] = {}
    for joint in joints:
        kind = joint.get("type")
        if kind not in KINDS:
            yield Fault(_at(joint, "type"), kind, f"one of {', '.join(KINDS)}")
        parent, child = (None if (end := joint.find(tag)) is None else end.get("link") for tag in _ENDS)
        for tag, link in zip(_ENDS, (parent, child), strict=True):
            if link is None or link not in names:
                yield Fault(_at(joint, tag), link, "the name of a link of this file")
        axis = joint.find("axis")
        along = None if axis is None else _numbers(axis.get("xyz", "1 0 0"), 3)
        if kind in MOVING and along is not None and not np.any(along):
            yield Fault(_at(joint, "axis.xyz"), axis.get("xyz"), "a direction, not zero")
        if child in child_of:
            yield Fault(_at(joint, "child"), child, f"a link that {child_of[child]} does not carry already")
        elif child:
            child_of[child] = joint.get("name", "another joint")
    roots = sorted(name for name in names if name and name not in child_of)
    if len(roots) > 1:
        yield Fault(_at(root), ", ".join(roots), "one root: a link that no joint carries")


_ENDS: Final = ("parent", "child")


def _number_faults(owner: Any) -> Iterator[Fault]:
    for element in owner.iter():
        for key, n in NUMBERS.get(element.tag, {}).items():
            text = element.get(key)
            if text is not None and _numbers(text, n) is None:
                yield Fault(_at(owner, f"{element.tag}.{key}"), text, _WISHES[n])


def _numbers(text: str, n: int) -> Floats | None:
    """Return n finite numbers of a text, None if it does not hold them."""
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        return None
    return values if values.shape == (n,) and np.isfinite(values).all() else None
