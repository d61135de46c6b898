"""URDF files: read by yourdfpy, checked before so that every fault is reported with its line and element.

What skins need is read: links and the joints between them. Inertias, shapes and transmissions are not.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.errors import ConfigError, Fault, SkinbusError

Floats = npt.NDArray[np.float64]

KINDS: Final = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
MOVING: Final = ("revolute", "continuous", "prismatic", "planar")
"""Kinds with an axis."""
MOST_OF_A_KIND: Final = 10
"""Faults of one kind that are reported: more say nothing new."""


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
    velocity: float = np.inf
    """Limit as in the URDF, rad/s or m/s."""


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

    faults = _few_of_each(_faults(_root(path)))
    if faults:
        raise ConfigError(str(path), faults)
    # neither the shapes nor yourdfpy's own kinematics are wanted: they take most of its time
    robot = URDF.load(str(path), build_scene_graph=False, load_meshes=False)
    joints = {
        joint.child: Joint(
            name=joint.name,
            kind=joint.type,
            parent=joint.parent,
            child=joint.child,
            X_PJ=np.eye(4) if joint.origin is None else np.asarray(joint.origin, float),
            axis=_unit(joint.axis),
            mimics=None if joint.mimic is None else joint.mimic.joint,
            lower=-np.inf if joint.limit is None or joint.limit.lower is None else float(joint.limit.lower),
            upper=np.inf if joint.limit is None or joint.limit.upper is None else float(joint.limit.upper),
            velocity=_velocity(joint.limit),
        )
        for joint in robot.robot.joints
    }
    base = next(link.name for link in robot.robot.links if link.name not in joints)
    ordered: list[Joint] = []
    reached = [base]
    for link in reached:  # grows while it is walked
        for joint in joints.values():
            if joint.parent == link:
                ordered.append(joint)
                reached.append(joint.child)
    return base, ordered


def names_in(path: str | Path) -> tuple[list[str], list[str]]:
    """Return the names of the links and joints of a URDF, whatever else is wrong with it.

    Raises:
        ConfigError: it cannot be read.
    """
    root = _root(path)
    links, joints = ([element.get("name") for element in root.findall(tag)] for tag in ("link", "joint"))
    return [name for name in links if name], [name for name in joints if name]


def _root(path: str | Path) -> Any:
    import lxml.etree as xml

    try:
        return xml.parse(str(path), xml.XMLParser(remove_comments=True, resolve_entities=False)).getroot()
    except OSError as error:
        raise ConfigError(str(path), [Fault("file", None, f"one that can be read ({error})")]) from None
    except xml.XMLSyntaxError as error:
        line = error.lineno
        raise ConfigError(str(path), [Fault(f"line {line}", None, f"XML: {error.msg}")]) from None


def _velocity(limit: Any) -> float:
    """Return the limit of a velocity, infinite where the URDF has none; 0 stands for none in many files."""
    return float(limit.velocity) if limit is not None and limit.velocity else np.inf


def _unit(axis: Any) -> Floats:
    axis = np.asarray(axis, float)
    length = float(np.linalg.norm(axis))
    return axis / length if length else np.array([1.0, 0.0, 0.0])


def _few_of_each(faults: Iterator[Fault]) -> list[Fault]:
    """Return the faults, at most ten with the same wish."""
    seen: Counter[str] = Counter()
    kept = []
    for fault in faults:
        seen[fault.wanted] += 1
        if seen[fault.wanted] <= MOST_OF_A_KIND:
            kept.append(fault)
    return kept


def _at(element: Any, key: str = "") -> str:
    """Return where an element is, for messages."""
    name = element.get("name")
    tag = f"<{element.tag}>" if name is None else f"<{element.tag} {name}>"
    return f"line {element.sourceline} {tag}{' ' if key else ''}{key}"


def _faults(root: Any) -> Iterator[Fault]:
    """Yield every fault of the parts of a URDF that are read."""
    if root.tag != "robot":
        yield Fault(_at(root), None, "<robot>, the element around a URDF")
        return
    links, joints = root.findall("link"), root.findall("joint")
    names = [link.get("name") for link in links]
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
    child_of: dict[str, str] = {}
    for joint in joints:
        yield from _joint_faults(joint, names)
        child = _link_of(joint, "child")
        if child in child_of:
            yield Fault(_at(joint, "child"), child, f"a link that {child_of[child]} does not carry already")
        elif child:
            child_of[child] = joint.get("name", "another joint")
    yield from _tree_faults(root, names, joints)


def _link_of(joint: Any, end: str) -> str | None:
    element = joint.find(end)
    return None if element is None else element.get("link")


def _joint_faults(joint: Any, links: list[str | None]) -> Iterator[Fault]:
    kind = joint.get("type")
    if kind not in KINDS:
        yield Fault(_at(joint, "type"), kind, f"one of {', '.join(KINDS)}")
    for end in ("parent", "child"):
        link = _link_of(joint, end)
        if link is None or link not in links:
            yield Fault(_at(joint, end), link, "the name of a link of this file")
    for tag, keys in (("origin", ("xyz", "rpy")), ("axis", ("xyz",))):
        element = joint.find(tag)
        for key in keys if element is not None else ():
            text = element.get(key)
            if text is not None and _numbers(text, 3) is None:
                yield Fault(_at(joint, f"{tag}.{key}"), text, "three finite numbers")
    axis = joint.find("axis")
    if kind in MOVING and axis is not None:
        along = _numbers(axis.get("xyz", "1 0 0"), 3)
        if along is not None and not np.any(along):
            yield Fault(_at(joint, "axis.xyz"), axis.get("xyz"), "a direction, not zero")
    limit = joint.find("limit")
    for key in ("lower", "upper") if limit is not None else ():
        text = limit.get(key)
        if text is not None and _numbers(text, 1) is None:
            yield Fault(_at(joint, f"limit.{key}"), text, "a finite number")
    mimic = joint.find("mimic")
    if mimic is not None and not mimic.get("joint"):
        yield Fault(_at(joint, "mimic.joint"), None, "the name of a joint")


def _numbers(text: str, n: int) -> Floats | None:
    """Return n finite numbers of a text, None if it does not hold them."""
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        return None
    return values if values.shape == (n,) and np.isfinite(values).all() else None


def _tree_faults(root: Any, names: list[str | None], joints: list[Any]) -> Iterator[Fault]:
    """Yield what keeps the links from being one tree."""
    parents = {_link_of(joint, "child"): _link_of(joint, "parent") for joint in joints}
    roots = sorted({name for name in names if name and name not in parents})
    if len(roots) > 1:
        yield Fault(_at(root), ", ".join(roots), "one root: a link that no joint carries")
    for name in parents:
        link, passed = name, set()
        while link in parents and link not in passed:
            passed.add(link)
            link = parents[link]
        if link == name:
            yield Fault(_at(root), name, "links without a loop of joints")
