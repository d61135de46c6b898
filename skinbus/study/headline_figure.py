"""The headline picture of an arm and the table of decisions above it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from skinbus.estimate import LEVELS
from skinbus.study.draw import COLOURS, MARKERS, new_figure, save
from skinbus.study.headline import CONDITIONS, Point
from skinbus.study.marked import Marks

MARKS: Final = Marks("<!-- decisions: made by skinbus study headline -->", "<!-- end of decisions -->")
FINGERS: Final = {1: "one finger", 2: "two fingers, 15-25 mm apart"}
AS_GOOD: Final = 1.2
"""An error within this factor of the least is as good: about what two draws of 400 cycles differ by."""
LINE: Final = 0.06
"""Of the height of a panel: a line of a label."""
UNBOUND_MM: Final = 1e3
"""A bound above this is none."""


def draw_headline(points: Sequence[Point], folder: Path) -> list[Path]:
    """Draw one arm: a row for each condition, a column for one finger and for two; same axes in all."""
    name = points[0].arm
    figure, panels = new_figure(2, 2, width=5.6, height=3.7)
    errors = [p.p95_mm for p in points] + [p.bound_p95_mm for p in points if p.bound_p95_mm < UNBOUND_MM]
    times = [p.latency_ms for p in points]
    spread = max(times) - min(times) + 1.0
    for row, condition in zip(panels, CONDITIONS, strict=True):
        for axes, fingers in zip(row, FINGERS, strict=True):
            axes.set_yscale("log")
            axes.set_ylim(0.6 * min(errors), 1.8 * max(errors))
            axes.set_xlim(min(times) - 0.1 * spread, max(times) + 0.8 * spread)
            axes.set_title(f"{FINGERS[fingers]}; {condition.name}")
            axes.set_xlabel("touch to contact: SYNC, wire, computing (ms)")
            axes.set_ylabel("error in 95 of 100 cycles (mm)")
            _draw_panel(axes, [p for p in points if p.condition == condition.name and p.fingers == fingers])
    figure.suptitle(f"{name}: accuracy against time. A wrong count is an error of a pitch at least")
    return save(figure, folder, f"headline-{name.replace(' ', '-')}")


def _draw_panel(axes: Any, points: Sequence[Point]) -> None:
    for point in points:
        colour = COLOURS[point.level]
        inner = colour if point.bits == 16 else "white"
        axes.plot(point.latency_ms, point.p95_mm, MARKERS[point.level], color=colour, mfc=inner, ms=7)
    low, high = axes.get_ylim()
    for bits in {p.bits for p in points}:
        column = sorted((p for p in points if p.bits == bits), key=lambda p: p.p95_mm)
        width = 0.02 * (axes.get_xlim()[1] - axes.get_xlim()[0])
        y = 0.0
        for point in column:
            # labels of points that lie together are moved apart
            y = max(math.log(point.p95_mm / low) / math.log(high / low), y + LINE)
            axes.text(
                max(p.latency_ms for p in column) + width,
                low * (high / low) ** y,
                f"{point.level}, {bits} bit: {point.p95_mm:.2g} mm, miscounted {point.wrong_count_pct:.0f} %",
                va="center",
                fontsize=7,
                color=COLOURS[point.level],
            )
    if points and (bound := points[0].bound_p95_mm) < UNBOUND_MM:
        axes.axhline(bound, color="black", ls="--", lw=1)
        axes.text(axes.get_xlim()[0], bound, " ideal estimator", va="bottom", fontsize=7)


def write_decisions(points: Sequence[Point]) -> str:
    """Return the table of decisions (Markdown): for each situation the cheapest that is as good as any."""
    lines = [
        "| arm | skin | fingers | run | error in 95 of 100 cycles | count wrong | computing, share of cycle "
        "| touch to contact | what else one could run |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for arm in dict.fromkeys(p.arm for p in points):
        for condition in CONDITIONS:
            for fingers, words in FINGERS.items():
                own = [p for p in points if (p.arm, p.condition, p.fingers) == (arm, condition.name, fingers)]
                best = decide(own)
                others = "; ".join(
                    f"{p.level} {p.bits} bit {p.p95_mm:.2g} mm, {p.wrong_count_pct:.0f} %"
                    for p in own
                    if p is not best
                )
                lines.append(
                    f"| {arm} | {condition.name} | {words} | **`{best.level}`, {best.bits} bit** "
                    f"| {best.p95_mm:.2g} mm | {best.wrong_count_pct:.0f} % "
                    f"| {best.compute_p99_us:.0f} us, {best.share_pct:.1f} % of {best.rate_hz:g} Hz "
                    f"| {best.latency_ms:.1f} ms | {others} |"
                )
    return "\n".join(lines)


def decide(points: Sequence[Point]) -> Point:
    """Return the point to run: of those as good as the best in 95 of 100 cycles, soonest, then simplest."""
    least = min(p.p95_mm for p in points)
    good = [p for p in points if p.p95_mm <= AS_GOOD * least]
    fewest = min(p.wrong_count_pct for p in good)
    # where all are off by a pitch or more, the count decides
    good = [p for p in good if p.wrong_count_pct <= AS_GOOD * fewest + 1.0]
    return min(good, key=lambda p: (round(p.latency_ms), LEVELS.index(p.level)))
