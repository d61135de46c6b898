"""One [[touch]] of a scene file, and the touch it means on an arm.

Where: ``xyz_mm``, a point of the surface; ``s_mm`` with ``angle_deg`` (closed surfaces) or ``a_mm``; or
``path``, keys of [t_s, s_mm, angle_deg], on planes [t_s, s_mm, a_mm]. With ``fixed_in = "base"`` a touch
stays where it begins, in the base of the robot, while the arm moves under it. How hard: ``force_n`` as keys
of [t_s, N]; or one number with ``start_s``, ``end_s`` and ``ramp_s`` at either end. All times are scene time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, Literal

import numpy as np
import numpy.typing as npt
from pydantic import ConfigDict

from skinbus.errors import Fault
from skinbus.model import Arm, Surface
from skinbus.model.mesh_surface import MeshSurface
from skinbus.sim.effect import parameter
from skinbus.sim.indenter import Shape
from skinbus.sim.touch import Touch

_SIZES: Final = {
    "point": (),
    "disc": ("diameter_mm",),
    "edge": ("length_mm",),
    "palm": ("length_mm", "width_mm"),
    "sphere": ("diameter_mm",),
}
"""Sizes that each shape needs; it takes no others."""

_PULSE_KEYS: Final = 17
"""Of a half sine; linear in between errs by 1 % of the peak at most, and by 0.3 % of the momentum."""
OFF: Final = 5e-3
"""m: a point of a touch further from the surface is not meant to be on it."""
_LEAST: Final = 0.02
"""Of the first impact; weaker bounces are left out."""

Millimetres = Annotated[float, parameter("mm", "a size", gt=0, le=1000)]
Keys2 = Annotated[tuple[tuple[float, float], ...], parameter("s, N", "force over time", min_length=2)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TouchTable:
    """[[touch]]: what presses where, when and how hard."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
    link: str
    s_mm: float | None = None
    angle_deg: float | None = None
    a_mm: float | None = None
    xyz_mm: tuple[float, float, float] | None = None
    path: (
        Annotated[tuple[tuple[float, float, float], ...], parameter("s, mm, deg", "keys", min_length=2)]
        | None
    ) = None
    fixed_in: Literal["link", "base"] = "link"
    force_n: Annotated[float, parameter("N", "force", ge=0, le=10_000)] | Keys2
    start_s: Annotated[float, parameter("s", "first contact", ge=0)] | None = None
    end_s: Annotated[float, parameter("s", "end of contact", gt=0)] | None = None
    ramp_s: Annotated[float, parameter("s", "rise and fall of a constant force", ge=0)] = 0.1
    shape: Literal["point", "disc", "edge", "palm", "sphere"] = "point"
    diameter_mm: Millimetres | None = None
    length_mm: Millimetres | None = None
    width_mm: Millimetres | None = None
    yaw_deg: float = 0.0
    # a fingertip of 16 mm diameter then touches over 13 mm at 10 N (assumed)
    modulus_kpa: Annotated[float, parameter("kPa", "of a sphere on the cover", gt=0)] = 200.0
    inclination: Annotated[float, parameter("", "tangential force per normal force", ge=0, le=10)] = 0.0
    direction_deg: Annotated[float, parameter("deg", "of the tangential force, from s towards a")] = 0.0
    impact_n: Annotated[float, parameter("N", "peak of the impact that a touch begins with", ge=0)] = 0.0
    # robots that hit soft parts of people: 5 to 20 ms (ISO/TS 15066, annex A; Haddadin et al. 2009)
    impact_ms: Annotated[float, parameter("ms", "duration of the impact", gt=0, le=1000)] = 10.0
    restitution: Annotated[float, parameter("", "speed after a bounce per speed before", ge=0, lt=1)] = 0.4


def touch_of(
    table: TouchTable, key: str, arm: Arm | None, duration_s: float | None, faults: list[Fault]
) -> Touch | None:
    """Return the touch that a table means, or None after adding its faults."""
    before = len(faults)
    force = _force(table, key, duration_s, faults)
    _check_shape(table, key, faults)
    link, path = 0, None
    if arm is not None:
        names = [link.name for link in arm.links]
        if table.link in names:
            link = names.index(table.link)
            path = _path(table, key, arm.links[link].surface, faults)
        else:
            faults.append(Fault(f"{key}.link", table.link, f"a link of arm {arm.name}: {', '.join(names)}"))
    if len(faults) > before or path is None or force is None:
        return None
    return Touch(
        link=link,
        path=path,
        force=with_impact(force, table),
        shape=Shape[table.shape.upper()],
        length=1e-3 * (table.diameter_mm or table.length_mm or 0.0),
        width=1e-3 * (table.width_mm or 0.0),
        yaw=math.radians(table.yaw_deg),
        modulus=1e3 * table.modulus_kpa,
        inclination=table.inclination,
        direction=math.radians(table.direction_deg),
    )


def _path(
    table: TouchTable, key: str, surface: Surface, faults: list[Fault]
) -> npt.NDArray[np.float64] | None:
    """Return the keys (n, 3) of t (s), s (m), a (m)."""
    before = len(faults)
    closed = surface.period > 0.0
    across = "angle_deg" if closed else "a_mm"
    for other in ("s_mm", "angle_deg", "a_mm", "path"):
        if table.xyz_mm is not None and (seen := getattr(table, other)) is not None:
            faults.append(Fault(f"{key}.{other}", seen, "nothing beside xyz_mm"))
    if table.xyz_mm is not None:
        (s,), (a,), (height,) = surface.project(1e-3 * np.array([table.xyz_mm]))
        if abs(height) > OFF:
            faults.append(
                Fault(f"{key}.xyz_mm", table.xyz_mm, f"on link {table.link}; {1e3 * height:.1f} mm over it")
            )
        keys = np.array([[0.0, s, a]])
    elif table.path is None:
        a = table.angle_deg if closed and table.a_mm is None else table.a_mm
        if table.s_mm is None:
            faults.append(Fault(f"{key}.s_mm", None, "a value, or a path"))
        if a is None:
            faults.append(
                Fault(f"{key}.{across}", None, f"a value, or a path; link {table.link} is a {surface.kind}")
            )
        if table.angle_deg is not None and (table.a_mm is not None or not closed):
            wanted = "not both of angle_deg and a_mm" if closed else f"a_mm on a {surface.kind}"
            faults.append(Fault(f"{key}.angle_deg", table.angle_deg, wanted))
        if len(faults) > before or table.s_mm is None or a is None:
            return None
        scale = 1e-3 if table.angle_deg is None else math.radians(1.0) * surface.radius
        keys = np.array([[0.0, 1e-3 * table.s_mm, scale * a]])
    else:
        if table.fixed_in == "base":
            faults.append(Fault(f"{key}.path", None, 'no path: fixed_in = "base" keeps it in one place'))
        for other in ("s_mm", "angle_deg", "a_mm"):
            if (seen := getattr(table, other)) is not None:
                faults.append(Fault(f"{key}.{other}", seen, "nothing beside a path"))
        scale = math.radians(1.0) * surface.radius if closed else 1e-3
        keys = np.array(table.path) * (1.0, 1e-3, scale)
        if (np.diff(keys[:, 0]) <= 0.0).any():
            faults.append(Fault(f"{key}.path", [k[0] for k in table.path], "times that grow"))
    outside = (keys[:, 1] < 0.0) | (keys[:, 1] > surface.length)
    if outside.any():
        wanted = f"0 to {1e3 * surface.length:g} mm, the length of link {table.link}"
        faults.append(
            Fault(
                f"{key}.{'s_mm' if table.path is None else 'path'}", 1e3 * float(keys[outside, 1][0]), wanted
            )
        )
    if not closed and (wide := np.abs(keys[:, 2]) > 0.5 * surface.width).any():
        wanted = f"within +-{500 * surface.width:g} mm, the width of link {table.link}"
        faults.append(
            Fault(f"{key}.{'a_mm' if table.path is None else 'path'}", 1e3 * float(keys[wide, 2][0]), wanted)
        )
    if isinstance(surface, MeshSurface) and not (on := surface.contains(keys[:, 1], keys[:, 2])).all():
        s, a = 1e3 * keys[~on][0, 1:]
        wanted = f"on the mesh of link {table.link}, near its boards"
        faults.append(Fault(f"{key}.{'path' if table.path else 's_mm'}", f"{s:.1f}, {a:.1f} mm", wanted))
    return keys


def _force(
    table: TouchTable, key: str, duration_s: float | None, faults: list[Fault]
) -> npt.NDArray[np.float64] | None:
    """Return the keys (n, 2) of t (s), F (N)."""
    before = len(faults)
    if isinstance(table.force_n, tuple):
        for other in ("start_s", "end_s"):
            if (seen := getattr(table, other)) is not None:
                faults.append(Fault(f"{key}.{other}", seen, "nothing beside keys of force_n"))
        keys = np.array(table.force_n)
        if (np.diff(keys[:, 0]) < 0.0).any() or keys[0, 0] < 0.0 or keys[-1, 0] <= keys[0, 0]:
            faults.append(Fault(f"{key}.force_n", [k[0] for k in table.force_n], "times from 0 on that grow"))
        if (keys[:, 1] < 0.0).any():
            faults.append(
                Fault(f"{key}.force_n", float(keys[:, 1].min()), "forces of 0 N or more: skin is not pulled")
            )
        end_key = "force_n"
    else:
        start = table.start_s or 0.0
        end = (
            table.end_s
            if table.end_s is not None
            else (duration_s if duration_s is not None else start + 1.0)
        )
        ramp = min(table.ramp_s, 0.5 * (end - start))
        if end <= start:
            faults.append(Fault(f"{key}.end_s", end, f"later than the start, {start:g} s"))
        f = table.force_n
        keys = np.array([[start, 0.0], [start + ramp, f], [end - ramp, f], [end, 0.0]])
        end_key = "end_s"
    if duration_s is not None and keys[-1, 0] > duration_s:
        wanted = f"at most the duration of the scene, {duration_s:g} s"
        faults.append(Fault(f"{key}.{end_key}", float(keys[-1, 0]), wanted))
    return keys if len(faults) == before else None


def with_impact(force: npt.NDArray[np.float64], table: TouchTable) -> npt.NDArray[np.float64]:
    """Return keys (n, 2) of a force that begins with an impact: after each bounce the speed is that before
    times the restitution, so that pulse and flight shrink alike; the force of the touch goes on beneath."""
    if table.impact_n == 0.0:
        return force
    start, end = force[0, 0], force[-1, 0]
    pulse = np.sin(np.linspace(0.0, np.pi, _PULSE_KEYS))
    length, peak = 1e-3 * table.impact_ms, table.impact_n
    begin, extra = start, [np.zeros((0, 2))]
    while peak > _LEAST * table.impact_n and begin + length < end:
        extra.append(np.column_stack([np.linspace(begin, begin + length, _PULSE_KEYS), peak * pulse]))
        # a half sine of this peak sends it up at a speed that brings it back after as long again
        begin += 2.0 * length
        peak *= table.restitution
    keys = np.concatenate(extra)
    times = np.union1d(force[:, 0], keys[:, 0])
    total = np.interp(times, force[:, 0], force[:, 1]) + np.interp(times, keys[:, 0], keys[:, 1], right=0.0)
    return np.column_stack([times, total])


def _check_shape(table: TouchTable, key: str, faults: list[Fault]) -> None:
    needed = _SIZES[table.shape]
    for size in ("diameter_mm", "length_mm", "width_mm"):
        seen = getattr(table, size)
        if size in needed and seen is None:
            faults.append(Fault(f"{key}.{size}", None, f"a value: the shape is {table.shape}"))
        if size not in needed and seen is not None:
            faults.append(Fault(f"{key}.{size}", seen, f"nothing: the shape is {table.shape}"))
