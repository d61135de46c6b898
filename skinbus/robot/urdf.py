"""URDF files: links and the joints between them; every fault is reported with its line and element.

What skins need is read. Inertias, shapes, transmissions and what drives can do are not.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from skinbus.arrays import Floats
from skinbus.errors import ConfigError, Fault, FaultList, extra_wanted
from skinbus.file_bytes import read_bytes

MOST_BYTES = 20_000_000
KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
NUMBERS = {
    "origin.xyz": (0.0, 0.0, 0.0),
    "origin.rpy": (0.0, 0.0, 0.0),
    "axis.xyz": (1.0, 0.0, 0.0),
    "limit.lower": (-np.inf,),
    "limit.upper": (np.inf,),
    "limit.velocity": (np.inf,),
}
"""Attributes of elements of a joint that hold numbers, and what they are where they are not given."""


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
        SkinbusError: lxml is not installed.
    """
    with extra_wanted("robot"):  # yourdfpy brings it
        import lxml.etree as xml
    try:
        root = xml.fromstring(
            read_bytes(Path(path), MOST_BYTES), xml.XMLParser(remove_comments=True, resolve_entities=False)
        )
    except xml.XMLSyntaxError as error:
        raise ConfigError.of(path, f"line {error.lineno}", None, f"XML: {error.msg}") from None
    if faults := FaultList(_faults(root)):
        raise ConfigError(path, faults)
    from_link: defaultdict[str, list[Joint]] = defaultdict(list)
    for element in root.findall("joint"):
        joint = _joint(element)
        from_link[joint.parent].append(joint)
    carried = {joint.child for joints in from_link.values() for joint in joints}
    base = next((name for link in root.findall("link") if (name := link.get("name")) not in carried), "")
    ordered = list(from_link[base])
    for joint in ordered:  # grows while it is walked
        ordered += from_link[joint.child]
    if loop := carried - {joint.child for joint in ordered}:
        raise ConfigError.of(path, _at(root), max(loop), "links without a loop of joints")
    return base, ordered


def _joint(element: Any) -> Joint:
    """Return the joint of an element without faults."""
    xyz, rpy, axis, *limits = (_numbers(element, key) for key in NUMBERS)
    lower, upper, velocity = (float(limit[0]) for limit in limits)
    X_PJ = np.eye(4)
    X_PJ[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    X_PJ[:3, 3] = xyz
    return Joint(
        name=element.get("name"),
        kind=element.get("type"),
        parent=_attribute(element, "parent.link"),
        child=_attribute(element, "child.link"),
        X_PJ=X_PJ,
        axis=axis / (np.linalg.norm(axis) or 1.0),
        mimics=_attribute(element, "mimic.joint"),
        lower=lower,
        upper=upper,
        velocity=abs(velocity) or np.inf,
    )


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
    names = {link.get("name") for link in links} - {None}
    child_of: dict[str, str] = {}
    for joint in joints:
        kind = joint.get("type")
        child = _attribute(joint, "child.link")
        if kind not in KINDS:
            yield Fault(_at(joint, "type"), kind, f"one of {', '.join(KINDS)}")
        for tag in ("parent", "child"):
            if (link := _attribute(joint, f"{tag}.link")) not in names:
                yield Fault(_at(joint, tag), link, "the name of a link of this file")
        for key, usual in NUMBERS.items():
            values = _numbers(joint, key)
            if len(values) != len(usual):
                wish = "three finite numbers" if len(usual) == 3 else "a finite number"
                yield Fault(_at(joint, key), _attribute(joint, key), wish)
            elif key == "axis.xyz" and not values.any() and kind not in ("fixed", "floating"):
                yield Fault(_at(joint, key), _attribute(joint, key), "a direction, not zero")
        if child in child_of:
            yield Fault(_at(joint, "child"), child, f"a link that {child_of[child]} does not carry already")
        elif child:
            child_of[child] = joint.get("name", "another joint")
    roots = sorted(names - {*child_of})
    if len(roots) > 1:
        yield Fault(_at(root), ", ".join(roots), "one root: a link that no joint carries")


def _attribute(joint: Any, key: str) -> Any:
    tag, _, name = key.partition(".")
    element = joint.find(tag)
    return None if element is None else element.get(name)


def _numbers(joint: Any, key: str) -> Floats:
    """Return the numbers of an attribute, or what it is where it is not given; none that are not finite."""
    text = _attribute(joint, key)
    try:
        values = np.array(NUMBERS[key] if text is None else [float(word) for word in text.split()])
    except ValueError:
        return np.zeros(0)
    return values if text is None or np.isfinite(values).all() else np.zeros(0)
