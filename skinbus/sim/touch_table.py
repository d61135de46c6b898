"""One [[touch]] of a scene file, and the touch it means on an arm.

Where: ``xyz_mm``, a point of the surface; ``s_mm`` with ``angle_deg`` (closed surfaces) or ``a_mm``; or
``path``, keys of [t_s, s_mm, angle_deg], on planes [t_s, s_mm, a_mm]. How hard: ``force_n`` as keys of
[t_s, N]; or one number with ``start_s``, ``end_s`` and ``ramp_s`` at either end. All times are scene time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from skinbus.arrays import Floats
from skinbus.errors import FaultList
from skinbus.model import Arm, Surface
from skinbus.model.mesh_surface import MeshSurface
from skinbus.sim.effect import parameter, settings
from skinbus.sim.indenter import Shape
from skinbus.sim.touch import Touch

_SIZES = {
    "point": (),
    "disc": ("diameter_mm",),
    "edge": ("length_mm",),
    "palm": ("length_mm", "width_mm"),
    "sphere": ("diameter_mm",),
}
"""Sizes that each shape needs; it takes no others."""

_PULSE = np.linspace(0.0, 1.0, 17)
"""Keys of a half sine; linear in between errs by 1 % of the peak at most."""
OFF = 5e-3
"""m: a point of a touch further from the surface is not meant to be on it."""

AddFault = Callable[[str, object, str], None]
"""Adds a fault of a key: what was seen, and what was wanted."""

Millimetres = Annotated[float, Field(gt=0, le=1000)]
Keys2 = Annotated[tuple[tuple[float, float], ...], Field(min_length=2)]


@settings
class TouchTable:
    """[[touch]]: what presses where, when and how hard."""

    link: str
    s_mm: float | None = None
    angle_deg: float | None = None
    a_mm: float | None = None
    xyz_mm: tuple[float, float, float] | None = None
    path: tuple[tuple[float, float, float], ...] | None = parameter(None, "s, mm, deg", "keys", min_length=2)
    force_n: Annotated[float, Field(ge=0, le=10_000)] | Keys2
    start_s: float | None = parameter(None, "s", "first contact", ge=0)
    end_s: float | None = parameter(None, "s", "end of contact", gt=0)
    ramp_s: float = parameter(0.1, "s", "rise and fall of a constant force", ge=0)
    shape: Literal["point", "disc", "edge", "palm", "sphere"] = "point"
    diameter_mm: Millimetres | None = None
    length_mm: Millimetres | None = None
    width_mm: Millimetres | None = None
    yaw_deg: float = 0.0
    # a fingertip of 16 mm diameter then touches over 13 mm at 10 N (assumed)
    modulus_kpa: float = parameter(200.0, "kPa", "of a sphere on the cover", gt=0)
    inclination: float = parameter(0.0, "", "tangential force per normal force", ge=0, le=10)
    direction_deg: float = parameter(0.0, "deg", "of the tangential force, from s towards a")
    impact_n: float = parameter(0.0, "N", "peak of the impact that a touch begins with", ge=0)
    # robots that hit soft parts of people: 5 to 20 ms (ISO/TS 15066, annex A; Haddadin et al. 2009)
    impact_ms: float = parameter(10.0, "ms", "duration of the impact", gt=0, le=1000)


def touch_of(
    table: TouchTable,
    key: str,
    arm: Arm | None,
    duration_s: float | None,
    faults: FaultList,
) -> Touch | None:
    """Return the touch that a table means, or None after adding its faults."""
    before = len(faults)

    def fault(name: str, seen: object, wanted: str) -> None:
        faults.add(f"{key}.{name}", seen, wanted)

    force = _force(table, duration_s, fault)
    for size in ("diameter_mm", "length_mm", "width_mm"):
        seen = getattr(table, size)
        if (seen is None) == (size in _SIZES[table.shape]):
            fault(size, seen, f"{'nothing' if seen else 'a value'}: the shape is {table.shape}")
    link, path = 0, None
    if arm is not None:
        names = [link.name for link in arm.links]
        if table.link in names:
            link = names.index(table.link)
            path = _path(table, arm.links[link].surface, fault)
        else:
            fault("link", table.link, f"a link of arm {arm.name}: {', '.join(names)}")
    if len(faults) > before or path is None:
        return None
    return Touch(
        link=link,
        path=path,
        force=_with_impact(force, table),
        shape=Shape[table.shape.upper()],
        length=1e-3 * (table.diameter_mm or table.length_mm or 0.0),
        width=1e-3 * (table.width_mm or 0.0),
        yaw=math.radians(table.yaw_deg),
        modulus=1e3 * table.modulus_kpa,
        inclination=table.inclination,
        direction=math.radians(table.direction_deg),
    )


def _beside(table: TouchTable, what: str, others: tuple[str, ...], fault: AddFault) -> None:
    """Add a fault for each key that may not stand beside another."""
    for other in others:
        if other != what and (seen := getattr(table, other)) is not None:
            fault(other, seen, f"nothing beside {what}")


def _path(table: TouchTable, surface: Surface, fault: AddFault) -> Floats | None:
    """Return the keys (n, 3) of t (s), s (m), a (m)."""
    closed, per_degree = surface.period > 0.0, math.radians(1.0) * surface.radius
    place = "s_mm" if table.path is None else "path"
    if table.xyz_mm is not None:
        place = "xyz_mm"
        (s,), (a,), (height,) = surface.project(1e-3 * np.array([table.xyz_mm]))
        if abs(height) > OFF:
            fault("xyz_mm", table.xyz_mm, f"on link {table.link}; {1e3 * height:.1f} mm over it")
        keys = np.array([[0.0, s, a]])
    elif table.path is not None:
        keys = np.array(table.path) * (1.0, 1e-3, per_degree if closed else 1e-3)
        if (np.diff(keys[:, 0]) <= 0.0).any():
            fault("path", [k[0] for k in table.path], "times that grow")
    else:
        around = table.angle_deg if closed and table.a_mm is None else table.a_mm
        if table.s_mm is None:
            fault("s_mm", None, "a value, or a path")
        if around is None:
            wanted = f"a value, or a path; link {table.link} is a {surface.kind}"
            fault("angle_deg" if closed else "a_mm", None, wanted)
        if table.angle_deg is not None and (table.a_mm is not None or not closed):
            wanted = "not both of angle_deg and a_mm" if closed else f"a_mm on a {surface.kind}"
            fault("angle_deg", table.angle_deg, wanted)
        if table.s_mm is None or around is None:
            return None
        keys = np.array([[0.0, 1e-3 * table.s_mm, (per_degree if table.a_mm is None else 1e-3) * around]])
    if place != "s_mm":
        _beside(table, place, ("s_mm", "angle_deg", "a_mm", "path"), fault)
    s, a = keys[:, 1:].T
    is_on = (s >= 0.0) & (s <= surface.length) & (closed | (np.abs(a) <= 0.5 * surface.width))
    near = ""
    if isinstance(surface, MeshSurface):
        is_on &= surface.contains(s, a)
        near = ", near its boards"
    if not is_on.all():
        across = "" if closed else f", a within +-{500 * surface.width:g} mm"
        wanted = f"on link {table.link}: s 0 to {1e3 * surface.length:g} mm{across}{near}"
        fault(place, "s {:.1f}, a {:.1f} mm".format(*1e3 * keys[~is_on][0, 1:]), wanted)
    return keys


def _force(table: TouchTable, duration_s: float | None, fault: AddFault) -> Floats:
    """Return the keys (n, 2) of t (s), F (N)."""
    end_key, f = "end_s", table.force_n
    if isinstance(f, tuple):
        end_key, keys = "force_n", np.array(f)
        _beside(table, "keys of force_n", ("start_s", "end_s"), fault)
        if (np.diff(keys[:, 0]) < 0.0).any() or keys[0, 0] < 0.0 or keys[-1, 0] <= keys[0, 0]:
            fault("force_n", [k[0] for k in f], "times from 0 on that grow")
        if (least := float(keys[:, 1].min())) < 0.0:
            fault("force_n", least, "forces of 0 N or more: skin is not pulled")
    else:
        start = table.start_s or 0.0
        end = table.end_s or duration_s or start + 1.0
        ramp = min(table.ramp_s, 0.5 * (end - start))
        if end <= start:
            fault("end_s", end, f"later than the start, {start:g} s")
        keys = np.array([[start, 0.0], [start + ramp, f], [end - ramp, f], [end, 0.0]])
    if duration_s is not None and keys[-1, 0] > duration_s:
        fault(end_key, float(keys[-1, 0]), f"at most the duration of the scene, {duration_s:g} s")
    return keys


def _with_impact(force: Floats, table: TouchTable) -> Floats:
    """Return keys (n, 2) of a force that begins with an impact: the force of the touch goes on beneath."""
    if table.impact_n == 0.0:
        return force
    pulse = force[0, 0] + 1e-3 * table.impact_ms * _PULSE
    times = np.union1d(force[:, 0], pulse)
    impact = np.interp(times, pulse, table.impact_n * np.sin(np.pi * _PULSE), right=0.0)
    return np.column_stack([times, np.interp(times, force[:, 0], force[:, 1]) + impact])
