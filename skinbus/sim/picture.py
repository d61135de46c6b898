"""Pictures: a scene with every link unrolled, boards, tactels and the path of each touch; what scenes cost.

Needs matplotlib (the extra ``figures``), imported only when a picture is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.errors import SkinbusError
from skinbus.model import PlacedPatch, Surface
from skinbus.sim.indenter import Shape
from skinbus.sim.scaling import ByEffects, ByPatches
from skinbus.sim.scene import Scene
from skinbus.sim.touch import Touch

Floats = npt.NDArray[np.float64]

_EDGE_POINTS: Final = 12
"""Points along each edge of a board: on a cone, edges are curves of the chart."""
_DPI: Final = 150
_WIDTH: Final = 9.0
"""Of the widest link, inches."""
_LEGEND: Final = 2.4
_NUMBER: Final = 0.008
"""Half the width of a patch's number, m."""


def save_picture(scene: Scene, path: Path) -> None:
    """Draw a scene into a file; its suffix says the format.

    Raises:
        SkinbusError: matplotlib is not installed.
    """
    links = scene.arm.links
    scale = _WIDTH / max(link.surface.width for link in links)  # inches per metre
    heights = [link.surface.length * scale for link in links]
    size = (_WIDTH + _LEGEND, sum(heights) + 0.9 * len(links) + 0.5)
    figure = _figure(size)
    axes = figure.subplots(len(links), 1, squeeze=False, height_ratios=heights)[:, 0]
    for number, ax in enumerate(axes):
        _draw_link(scene, number, ax)
    if scene.touches:
        figure.legend(loc="outside right upper", frameon=False, title="touch")
    figure.suptitle(f"{scene.name}: {scene.title}" if scene.title else scene.name)
    figure.savefig(path, dpi=_DPI)


def save_cost_figure(patches: Sequence[ByPatches], effects: Sequence[ByEffects], path: Path) -> None:
    """Draw how cost grows with patches and with effects into a file.

    Raises:
        SkinbusError: matplotlib is not installed.
    """
    figure = _figure((10.0, 8.0))
    above, below = figure.subplots(2, 1, height_ratios=(1.0, 1.2))
    n = [row.n_patches for row in patches]
    lines = {
        "scene to counts: quiet, no effects": [row.quiet for row in patches],
        "five touches": [row.touched for row in patches],
        "five touches, gain spread, noise, adc": [row.noisy for row in patches],
        "the same with boards and frames": [row.world for row in patches],
    }
    for label, us in lines.items():
        above.plot(n, us, ".-", label=label)
    above.axhline(1000.0, color="0.6", linestyle="--", label="real time at 1 kHz")
    above.set(xlabel="patches of 16 tactels", ylabel="us per cycle", yscale="log", xlim=(0, None))
    above.set(title="what an arm costs")
    above.legend(frameon=False, fontsize=8, loc="center right", bbox_to_anchor=(1.0, 0.28))
    below.bar([row.n_effects for row in effects], [row.us for row in effects], color="C3")
    names = ["none", *(f"+ {row.added}" for row in effects[1:])]
    below.set_xticks([row.n_effects for row in effects], names, rotation=60, ha="right", fontsize=8)
    below.set(
        ylabel="us per cycle", title="24 patches, five touches, boards and frames; effects added one by one"
    )
    figure.savefig(path, dpi=_DPI)


def outline(surface: Surface, placed: PlacedPatch) -> Floats:
    """Return the outline of a board on the chart, (n, 2) m: s and a, a not wrapped."""
    half_u, half_v = (0.5 * size for size in placed.patch.size)
    t = np.linspace(-1.0, 1.0, _EDGE_POINTS, endpoint=False)
    one = np.ones_like(t)
    u = half_u * np.concatenate([t, one, -t, -one])
    v = half_v * np.concatenate([-one, t, one, -t])
    s, a = placed.on_link(surface, np.stack([u, v], -1))
    return np.stack([s, placed.a + surface.wrap(a - placed.a)], -1)


def number_place(surface: Surface, placed: PlacedPatch) -> tuple[float, float]:
    """Return where the number of a patch is written, a and s in mm: on it, and whole even at the wrap."""
    most = max(0.5 * surface.width - _NUMBER, 0.0)
    a = float(surface.wrap(placed.a))
    return 1e3 * min(max(a, -most), most), 1e3 * placed.s


def _figure(size: tuple[float, float]) -> Any:
    """Return an empty figure, the only place that imports matplotlib."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise SkinbusError("a picture needs matplotlib: pip install skinbus[figures]") from error
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _draw_link(scene: Scene, number: int, ax: Any) -> None:
    """Draw one link: a to the right, s downwards, mm; what crosses the wrap is drawn on both sides."""
    arm, link = scene.arm, scene.arm.links[number]
    surface = link.surface
    turns = (-surface.period, 0.0, surface.period) if surface.period else (0.0,)
    for p, placed in enumerate(arm.patches):
        if placed.link != number:
            continue
        at = arm.tactels_of(p)
        for turn in turns:
            ax.add_patch(
                _polygon(1e3 * (outline(surface, placed)[:, ::-1] + (turn, 0.0)), fill="0.95", edge="0.6")
            )
            for s, a in zip(arm.tactel_s[at], arm.tactel_a[at], strict=True):
                ax.add_patch(_circle(1e3 * (a + turn), 1e3 * s, 500.0 * placed.patch.diameter))
        ax.text(
            *number_place(surface, placed),
            arm.node_label(p),
            ha="center",
            va="center",
            color="0.3",
            size=8,
            zorder=5,  # above touches
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0.5},
        )
    for k, touch in enumerate(scene.touches):
        if touch.link == number:
            _draw_touch(ax, touch, k, surface, turns)
    half = 500.0 * surface.width
    ax.set(xlim=(-half, half), ylim=(1e3 * surface.length, 0.0), aspect="equal", title=link.name)
    ax.set(xlabel="a, mm" if surface.kind == "plane" else "a, mm (around)", ylabel="s, mm")


def _draw_touch(ax: Any, touch: Touch, k: int, surface: Surface, turns: tuple[float, ...]) -> None:
    """Draw a touch: what it covers where it begins, its path, and its largest force."""
    color = f"C{k % 10}"
    keys = touch.path
    first = float(surface.wrap(keys[0, 2]))
    offset = first - keys[0, 2]
    windings = range(-2, 3) if surface.period else (0,)
    if len(keys) > 1:
        for n in windings:
            a, s = 1e3 * (keys[:, 2] + offset + n * surface.period), 1e3 * keys[:, 1]
            ax.plot(a, s, "-", color=color, linewidth=1.5, zorder=3)
            da, ds = a[-1] - a[-2], s[-1] - s[-2]
            head = 6.0 / max(float(np.hypot(da, ds)), 1e-9)  # an arrowhead of 6 mm
            ax.annotate(
                "",
                (a[-1], s[-1]),
                (a[-1] - head * da, s[-1] - head * ds),
                arrowprops={"arrowstyle": "->", "color": color},
                annotation_clip=True,
            )
    cover = _covered(touch)
    for turn in turns:
        shifted = 1e3 * (cover + np.array([first + turn, keys[0, 1]]))
        ax.add_patch(_polygon(shifted, fill="none", edge=color, linewidth=1.5))
    peak = touch.force[:, 1].max()
    what = "" if touch.shape is Shape.POINT else f", {touch.shape.name.lower()}"
    label = f"{k + 1}  {peak:g} N{what}, {touch.start:g} to {touch.end:g} s"
    at = (1e3 * first, 1e3 * keys[0, 1])
    ax.plot(*at, "+", color=color, zorder=3, label=label)
    ax.annotate(str(k + 1), at, (4, 4), textcoords="offset points", color=color, weight="bold", zorder=6)


def _covered(touch: Touch) -> Floats:
    """Return the outline of an indenter about its centre, (n, 2) m: a and s."""
    angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    length, width = touch.length, touch.width
    if touch.shape is Shape.POINT:
        length = width = 1e-3
    elif touch.shape is Shape.DISC:
        width = length
    elif touch.shape is Shape.EDGE:
        width = 1e-3
    u, v = 0.5 * length * np.cos(angle), 0.5 * width * np.sin(angle)
    cos, sin = np.cos(touch.yaw), np.sin(touch.yaw)
    return np.stack([sin * u + cos * v, cos * u - sin * v], -1)


def _polygon(points: Floats, *, fill: str, edge: str, linewidth: float = 0.8) -> Any:
    from matplotlib.patches import Polygon

    return Polygon(points, closed=True, facecolor=fill, edgecolor=edge, linewidth=linewidth)


def _circle(x: float, y: float, radius: float) -> Any:
    from matplotlib.patches import Circle

    return Circle((x, y), radius, facecolor="0.85", edgecolor="none")
