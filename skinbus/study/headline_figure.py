"""The headline picture of an arm and the table of decisions above it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import isotonic_regression

from skinbus.estimate import LEVELS
from skinbus.study.draw import COLOURS, MARKERS, new_figure, save
from skinbus.study.headline import CONDITIONS, Point
from skinbus.study.marked import Marks

MARKS: Final = Marks("<!-- decisions: made by skinbus study headline -->", "<!-- end of decisions -->")
FINGERS: Final = {1: "one finger", 2: "two fingers, 15-25 mm apart"}
AS_GOOD: Final = 1.2
"""An error within this factor of the least is as good: about what two draws of 400 cycles differ by."""
SEEN_PCT: Final = 5.0
"""Wrong counts above this stand above their points: they decide where errors are alike."""
LABEL_SHARE: Final = 0.1
"""Of the width of a panel that a label takes; that of two lines of font 7 is 0.08."""
LABELS_AT: Final = 0.86
"""Of the height of a panel, where labels stand: the points end at about 0.75 of it."""
UNBOUND_MM: Final = 1e3
"""A bound above this is none."""


def draw_headline(points: Sequence[Point], folder: Path) -> list[Path]:
    """Write the picture of one arm; return its files."""
    return save(compose_headline(points), folder, f"headline-{points[0].arm.replace(' ', '-')}")


def compose_headline(points: Sequence[Point]) -> Figure:
    """Draw one arm: a row for each condition, a column for one finger and for two; same axes in all."""
    figure, panels = new_figure(2, 2, width=5.6, height=4.0)
    errors = [p.p95_mm for p in points] + [p.bound_p95_mm for p in points if p.bound_p95_mm < UNBOUND_MM]
    times = [p.latency_ms for p in points]
    for row, condition in zip(panels, CONDITIONS, strict=True):
        for axes, fingers in zip(row, FINGERS, strict=True):
            axes.set_xscale("log")
            axes.set_yscale("log")
            # room for labels above the points and for the one to run below them
            axes.set_ylim(0.12 * min(errors), 4.0 * max(errors))
            axes.set_xlim(0.9 * min(times), 1.1 * max(times))
            axes.set_title(f"{FINGERS[fingers]}; {condition.name}")
            axes.set_xlabel("touch to contact: SYNC, wire, computing (ms)")
            axes.set_ylabel("error in 95 of 100 cycles (mm)")
            _draw_panel(axes, [p for p in points if p.condition == condition.name and p.fingers == fingers])
    figure.suptitle(f"{points[0].arm}: accuracy against time. A wrong count is an error of a pitch at least")
    return figure


def _draw_panel(axes: Any, points: Sequence[Point]) -> None:
    for point in points:
        colour = COLOURS[point.level]
        axes.plot(
            point.latency_ms,
            point.p95_mm,
            MARKERS[point.level],
            color=colour,
            mfc=colour if point.bits == 16 else "none",
            # those that lie on each other are seen as rings
            ms=7 + 3 * LEVELS.index(point.level) if point.bits == 8 else 7,
            label=f"{point.level}, {point.bits} bit: {point.p95_mm:.2g} mm, wrong count "
            f"{point.wrong_count_pct:.0f} %, {point.latency_ms:.0f} ms",
        )
    _label_wrong_counts(axes, [p for p in points if p.wrong_count_pct > SEEN_PCT])
    if points:
        _mark(axes, decide(points))
    if points and (bound := points[0].bound_p95_mm) < UNBOUND_MM:
        axes.axhline(bound, color="black", ls="--", lw=1, label=f"ideal estimator, 16 bit: {bound:.2g} mm")
    axes.legend(
        fontsize=7,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.16),
        ncols=2,
        labelspacing=0.8,
        columnspacing=1.0,
    )


def _label_wrong_counts(axes: Any, points: Sequence[Point]) -> None:
    """Write them in one row above all points, as near to their own as labels are wide."""
    points = sorted(points, key=lambda p: p.latency_ms)
    if not points:
        return
    ends, room = np.log(axes.get_xlim()), LABEL_SHARE * np.arange(len(points))
    wanted = (np.log([p.latency_ms for p in points]) - ends[0]) / (ends[1] - ends[0])
    # in order and a label apart: what is left of each place without the labels before it never falls
    left = isotonic_regression(wanted - room).x
    places = np.clip(left, 0.5 * LABEL_SHARE, 1.0 - 0.5 * LABEL_SHARE - room[-1]) + room
    for point, x in zip(points, places, strict=True):
        axes.annotate(
            f"{point.wrong_count_pct:.0f} %\nwrong",
            (point.latency_ms, point.p95_mm),
            (x, LABELS_AT),
            textcoords="axes fraction",
            ha="center",
            fontsize=7,
            arrowprops={"arrowstyle": "-", "color": "grey", "lw": 0.6, "shrinkB": 6.0},
        )


def _mark(axes: Any, best: Point) -> None:
    """Mark the point to run, with what it costs and what it buys, in the room below all points."""
    where = best.latency_ms, best.p95_mm
    axes.plot(*where, "o", ms=22, mfc="none", mec="black", mew=1.5)
    axes.annotate(
        f"run {best.level}, {best.bits} bit: {best.p95_mm:.2g} mm, "
        f"wrong count {best.wrong_count_pct:.0f} %,\n"
        f"{best.compute_p99_us:.0f} us, {best.share_pct:.1f} % of a cycle at {best.rate_hz:g} Hz",
        where,
        (0.5, 0.04),
        textcoords="axes fraction",
        ha="center",
        va="bottom",
        fontsize=8,
        fontweight="bold",
        arrowprops={"arrowstyle": "-", "color": "black", "lw": 0.8, "shrinkB": 11.0},
    )


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
