"""The tables of docs/estimator.md: which families are measured, what they must reach, and how a row reads."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from typing import Final

from skinbus.estimate import LEVELS
from skinbus.study.accuracy import CHUNK, Cases, Tally, run_chunk
from skinbus.study.marked import Marks

SEED: Final = 90_000
"""Of the tables; seeds below 100 are used in tests and for tuning."""
QUICK: Final = 20
"""A quick table has so many times fewer cases."""
IDLE_CHUNK: Final = 20_000
"""Cycles without a touch in one piece of work."""
COVARIANCE: Final = (0.9, 1.1)
MARKS: Final = Marks("<!-- tables: made by skinbus study estimator -->", "<!-- end of tables -->")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AccuracyRow:
    """A family of cases, its name, and its limits: the most of a ratio or error, the least of a count."""

    title: str
    cases: Cases
    must: dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class AccuracyTable:
    """Rows under one headline, and the figures that they show."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[AccuracyRow, ...]


def _row(title: str, skin: str, draw: str, level: str, cases: int, **must: float) -> AccuracyRow:
    names = {
        "position": "position ratio",
        "force": "force ratio",
        "count": "count right",
        "rms_mm": "RMS position mm",
        "rms_force": "RMS force %",
        "false": "false contacts",
    }
    limits = {names[key]: limit for key, limit in must.items()}
    return AccuracyRow(title=title, cases=Cases(skin=skin, draw=draw, level=level, cases=cases), must=limits)


_RATIOS = ("count right", "position ratio", "force ratio", "covariance")
_ERRORS = (
    "count right",
    "RMS position mm",
    "bound RMS position mm",
    "RMS force %",
    "bound RMS force %",
    "position ratio",
    "force ratio",
    "covariance",
)
_INSIDE, _SEAM = (
    "one contact, 2-20 N, inside a patch",
    "one contact, 5 N, on a seam or a corner of four patches",
)

TABLES: Final = (
    AccuracyTable(
        title="Cone truth",
        columns=_RATIOS,
        rows=(
            _row(_INSIDE, "pad", "one 2-20 N", "fit", 2_000, position=1.1, force=1.1),
            _row(_INSIDE, "pad", "one 2-20 N", "full", 2_000, position=1.1, force=1.1),
            _row(_SEAM, "forearm", "seam", "fit", 2_000, position=1.2, force=1.2, count=0.99),
            _row(_SEAM, "forearm", "seam", "full", 2_000, position=1.2, force=1.2, count=0.99),
            _row(
                "two contacts of 5 N, 6 to 40 mm apart, inside",
                *("pad", "two", "full", 2_000),
                position=1.2, force=1.2, count=0.98,
            ),
            _row(
                "the same across seams",
                *("forearm", "two on seam", "full", 2_000),
                position=1.3, force=1.3, count=0.95,
            ),
            _row("three contacts of 5 N, 15 mm and more apart", "pad", "three", "full", 2_000, count=0.95),
        ),
    ),
    AccuracyTable(
        title="No contact: a forearm of 24 patches, noise alone",
        columns=("false contacts",),
        rows=tuple(
            _row("no contact", "forearm", "nothing", level, 1_000_000, false=0.0)
            for level in LEVELS
        ),
    ),
    *(
        AccuracyTable(
            title=f"Realistic truth, pressed by a {name}",
            columns=_ERRORS,
            rows=(
                _row("one contact, 5-20 N", skin, "one 5-20 N", "full", 1_000, rms_mm=0.3, rms_force=3.0),
                _row("one contact, 2 N", skin, "one 2 N", "full", 1_000, rms_mm=0.7, rms_force=6.0),
                _row(
                    "two contacts of 5 N, 15 mm apart",
                    *(skin, "two 15 mm", "full", 1_000),
                    count=0.95, rms_mm=0.6,
                ),
            ),
        )
        for skin, name in (("finger", "disc of 12 mm"), ("tip", "tip of 2 mm"))
    ),
    AccuracyTable(
        title="Calibrated with a disc of 12 mm, pressed by something else",
        columns=("count right", "RMS position mm", "RMS force %", "covariance"),
        rows=(
            _row("one thumb of 25 mm, 2-20 N", "finger, thumb", "one 2-20 N", "full", 1_000),
            _row("one tip of 2 mm, 2-20 N", "finger, tip", "one 2-20 N", "full", 1_000),
        ),
    ),
    AccuracyTable(
        title="Out of the box: rubber that nobody has calibrated, the law that boards ship with",
        columns=("count right", "RMS position mm", "RMS force %", "covariance"),
        rows=(
            *(_row("one finger of 12 mm, 2-20 N", "box", "one 2-20 N", level, 1_000) for level in LEVELS),
            *(
                _row("one finger, 5 N, on a seam or corner", "box forearm", "seam", level, 1_000)
                for level in LEVELS
            ),
            _row("two fingers of 5 N, 15 mm apart", "box", "two 15 mm", "full", 1_000),
            _row("two fingers of 5 N, across seams", "box forearm", "two on seam", "full", 1_000),
            _row("one thumb of 25 mm, 2-20 N", "box thumb", "one 2-20 N", "full", 1_000),
            _row("one tip of 2 mm, 2-20 N", "box tip", "one 2-20 N", "full", 1_000),
        ),
    ),
    AccuracyTable(
        title="Layouts that are not grids, cone truth: one contact of 2-20 N, two of 5 N 6 to 40 mm apart",
        columns=_RATIOS,
        rows=tuple(
            _row(f"{name}: {draw.split()[0]}", skin, draw, "full", 1_000)
            for skin, name in (
                ("hexagon", "six triangles, 61 tactels on one patch"),
                ("shell", "60 triangles, each a patch, on half a tube"),
            )
            for draw in ("one anywhere", "two anywhere")
        ),
    ),
)  # fmt: skip


def pieces(*, quick: bool) -> list[tuple[AccuracyRow, int, int]]:
    """Return the work of all tables: row, number of the piece, cases of it."""
    work = []
    for table in TABLES:
        for row in table.rows:
            idle = row.cases.draw == "nothing"
            total = max(row.cases.cases // (QUICK if quick else 1), CHUNK)
            size = IDLE_CHUNK if idle else CHUNK
            work += [(row, k, min(size, total - k * size)) for k in range(math.ceil(total / size))]
    return work


def measure(
    executor: Executor, *, seed: int, quick: bool, done: Callable[[int], None] = lambda n: None
) -> dict[AccuracyRow, Tally]:
    """Return the tally of every row; ``done`` is called with 1 as each piece comes."""
    work = pieces(quick=quick)
    futures = {executor.submit(run_chunk, row.cases, k, n, seed): (row, k) for row, k, n in work}
    found: dict[tuple[str, str, int], Tally] = {}
    try:
        for future in as_completed(futures):
            row, k = futures[future]
            found[row.cases.key, row.cases.level, k] = future.result()
            done(1)
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    tallies: dict[AccuracyRow, Tally] = {}
    # in the order of the pieces, whichever came first: the same seed gives the same table
    for row, k in futures.values():
        tallies.setdefault(row, Tally())
        tallies[row] += found[row.cases.key, row.cases.level, k]
    return tallies


def kept(name: str, value: float, limit: float) -> bool:
    """Return whether a figure keeps its limit."""
    return value >= limit if name == "count right" else value <= limit


def missed(tallies: dict[AccuracyRow, Tally]) -> list[str]:
    """Return a line for every figure that misses what it must reach."""
    lines = []
    for row, tally in tallies.items():
        figures = tally.figures()
        where = f"{row.title} ({row.cases.skin}, {row.cases.level})"
        lines += [
            f"{where}: {name} {figures[name]:.4g}, must {limit:g}"
            for name, limit in row.must.items()
            if not kept(name, figures[name], limit)
        ]
        if row.must and tally.nees and not COVARIANCE[0] <= figures["covariance"] <= COVARIANCE[1]:
            lines.append(f"{where}: covariance {figures['covariance']:.3f}, must be 0.9 to 1.1")
    return lines


def write_tables(tallies: dict[AccuracyRow, Tally], *, seed: int) -> str:
    """Return the tables in Markdown."""
    lines = [f"Seed {seed}.", ""]
    for table in TABLES:
        lines += [f"### {table.title}", ""]
        lines.append(f"| case | level | cases | excluded | {' | '.join(table.columns)} |")
        lines.append("|---|---|---|---|" + "---|" * len(table.columns))
        for row in table.rows:
            tally = tallies[row]
            figures = tally.figures()
            cells = [_cell(name, figures[name], row.must) for name in table.columns]
            head = f"{row.title} | {row.cases.level} | {tally.cases} | {tally.excluded}"
            lines.append(f"| {head} | {' | '.join(cells)} |")
        lines.append("")
    return "\n".join(lines)


def _cell(name: str, value: float, must: dict[str, float]) -> str:
    digits = {"count right": 4, "false contacts": 0}.get(name, 2)
    shown = f"{value:.{digits}f}"
    limit = must.get(name)
    if math.isnan(value):
        return "-"
    if name == "covariance" and must and not COVARIANCE[0] <= value <= COVARIANCE[1]:
        return f"{shown} **missed**"
    if limit is None:
        return shown
    sign = "≥" if name == "count right" else "≤"
    return f"{shown} ({sign} {limit:g})" + ("" if kept(name, value, limit) else " **missed**")
