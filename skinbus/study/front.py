"""The pictures of accuracy against time, iterations, bits, density and patches on the bus, from one table."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skinbus.estimate import LEVELS
from skinbus.objects.eds import load_eds
from skinbus.planning.plan import largest_rate
from skinbus.planning.schedule import CycleDelays
from skinbus.planning.traffic import Beside
from skinbus.study.cases import FAMILIES, LAWS, PITCHES
from skinbus.study.draw import COLOURS, MARKERS, new_figure, save
from skinbus.study.end_to_end import EndToEndRow
from skinbus.study.methods import SCIPY_FIT, SCIPY_KMEANS, SKLEARN_KMEANS

Row = dict[str, Any]

TITLES = {
    "one": "one touch, one board",
    "two": "two touches, one board",
    "seam": "one touch across a seam",
    "forearm": "five touches, 24 boards",
}
LAW_TITLES = {
    "cone": "cone is true and fitted",
    "elastic-cone": "elastic layer, cone fitted",
    "elastic-radial": "elastic layer, calibrated law",
}
BOUND = "median at the Cramer-Rao bound"
PATCHES = (1, 2, 4, 8, 12, 16, 24, 32, 48, 64, 96, 126)


def make_figures(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw every picture that the rows suffice for; return the files."""
    files = draw_budget(rows, folder)
    rows = _some(rows, budget=0)
    for family in FAMILIES:
        files += draw_front(rows, family, folder)
    files += draw_iterations(rows, folder)
    files += draw_bits(rows, folder)
    files += draw_density(rows, folder)
    files += draw_patches(folder)
    return files


def missing(rows: Sequence[Row]) -> list[str]:
    """Return what the pictures show and a table does not have: families with a law, as of a small grid."""
    there = {(row["family"], row["law"]) for row in rows}
    return [f"{family} with {law}" for family in FAMILIES for law in LAWS if (family, law) not in there]


def non_dominated(points: Sequence[tuple[float, float]]) -> list[int]:
    """Return the indices of points that no other beats in one coordinate without losing in the other."""
    best: list[int] = []
    for i in sorted(range(len(points)), key=lambda i: points[i]):
        if not best or points[i][1] < points[best[-1]][1]:
            best.append(i)
    return best


def draw_front(rows: Sequence[Row], family: str, folder: Path) -> list[Path]:
    """Draw the position error of all methods against their time, one panel for each law."""
    figure, panels = new_figure(len(LAWS), width=4.3, height=3.8)
    for axes, law in zip(panels[0], LAWS, strict=True):
        own = _some(rows, family=family, law=law, side=4, bits=16, iterations=0)
        points = []
        for method in dict.fromkeys(row["method"] for row in own):
            t, error = (_mean(_some(own, method=method), c) for c in ("compute_p50_us", "position_median_mm"))
            t99 = _mean(_some(own, method=method), "compute_p99_us")
            axes.plot(
                [t, t99], [error, error], "-", color=COLOURS.get(method, "tab:brown"), lw=0.8, alpha=0.5
            )
            axes.plot(
                t, error, MARKERS.get(method, "x"), color=COLOURS.get(method, "tab:brown"), ms=6, label=method
            )
            points.append((t, error))
        front = [points[i] for i in non_dominated(points)]
        if front:
            axes.step(*zip(*front, strict=True), where="post", color="grey", lw=1, label="not dominated")
        else:
            axes.text(0.5, 0.5, "not in this table", transform=axes.transAxes, ha="center")
        _draw_bound(axes, own, "--")
        axes.axvline(_mean(own, "wire_us"), color="black", ls=":", lw=1, label="time on the wire")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_title(LAW_TITLES[law])
        axes.set_xlabel("compute time of a cycle, p50 to p99 (us)")
        axes.set_ylabel("median position error (mm)")
    panels[0][0].legend(fontsize=6.5)
    figure.suptitle(TITLES[family])
    return save(figure, folder, f"front-{family}")


def draw_iterations(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the error of methods that were stopped early against their iterations."""
    families, law = ("one", "two"), "elastic-radial"
    figure, panels = new_figure(len(families), width=4.6)
    for axes, family in zip(panels[0], families, strict=True):
        own = _some(rows, family=family, law=law, side=4, bits=16)
        for method in (SCIPY_FIT, SCIPY_KMEANS, SKLEARN_KMEANS):
            bounded = [row for row in own if row["method"] == method and row["iterations"]]
            _line(axes, bounded, "iterations", "position_median_mm", method, COLOURS.get(method, "tab:brown"))
        for level in LEVELS:
            error = _mean(_some(own, method=level, iterations=0), "position_median_mm")
            axes.axhline(error, color=COLOURS[level], ls="--", lw=1, label=f"{level}, to the end")
        _draw_bound(axes, own, ":")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_title(TITLES[family])
        axes.set_xlabel("iterations (evaluations of the law for least squares)")
        axes.set_ylabel("median position error (mm)")
    panels[0][0].legend(fontsize=6.5)
    return save(figure, folder, "error-iterations")


def draw_budget(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw error and wrong counts of levels that were cut short against the time they took."""
    families, law = ("two", "forearm"), "elastic-radial"
    columns = (("position_median_mm", "median position error (mm)"), ("wrong_count_pct", "wrong count (%)"))
    figure, panels = new_figure(len(families) * len(columns), width=3.6)
    places = iter(panels[0])
    for family in families:
        own = _some(rows, family=family, law=law, side=4, bits=16, iterations=0)
        for column, title in columns:
            axes = next(places)
            for level in LEVELS[1:]:
                cut = [row for row in own if row["method"] == level and row["budget"]]
                budgets = sorted({row["budget"] for row in cut})
                points = [
                    tuple(_mean(_some(cut, budget=budget), name) for name in ("compute_p50_us", column))
                    for budget in budgets
                ]
                if points:
                    axes.plot(*zip(*points, strict=True), marker="o", ms=3, color=COLOURS[level], label=level)
            for level in LEVELS:
                whole = _some(own, method=level, budget=0)
                axes.plot(
                    _mean(whole, "compute_p50_us"),
                    _mean(whole, column),
                    MARKERS[level],
                    color=COLOURS[level],
                    ms=8,
                    mfc="none",
                    label=f"{level}, no limit",
                )
            axes.set_xscale("log")
            if column == columns[0][0]:
                _draw_bound(axes, own, ":")
                axes.set_yscale("log")
            axes.set_title(TITLES[family])
            axes.set_xlabel("compute time of a cycle, p50 (us)")
            axes.set_ylabel(title)
    panels[0][0].legend(fontsize=6.5)
    return save(figure, folder, "error-budget")


def draw_bits(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the error against the bits of the converter."""
    families = ("one", "two", "forearm")
    figure, panels = new_figure(len(families), width=4.0)
    for axes, family in zip(panels[0], families, strict=True):
        own = _some(rows, family=family, law="elastic-radial", side=4, iterations=0)
        for level in LEVELS:
            _line(axes, _some(own, method=level), "bits", "position_median_mm", level, COLOURS[level])
        _line(
            axes,
            [r for r in own if r["method"] == "fit"],
            "bits",
            "crb_mm",
            BOUND,
            "black",
        )
        axes.axvspan(3.5, 8.5, color="grey", alpha=0.1, label="a byte on the wire")
        axes.set_yscale("log")
        axes.set_title(TITLES[family])
        axes.set_xlabel("bits of a reading")
        axes.set_ylabel("median position error (mm)")
    panels[0][0].legend(fontsize=6.5)
    return save(figure, folder, "error-bits")


def draw_density(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the error against the pitch of the tactels, and what the readings take on the wire."""
    figure, panels = new_figure(len(LAWS), width=4.0)
    for axes, law in zip(panels[0], LAWS, strict=True):
        own = _some(rows, family="one", law=law, bits=16, iterations=0)
        for level in LEVELS:
            found = [{**row, "pitch_mm": 1e3 * PITCHES[row["side"]]} for row in _some(own, method=level)]
            _line(axes, found, "pitch_mm", "position_median_mm", level, COLOURS[level])
            if level == "fit":
                _line(axes, found, "pitch_mm", "crb_mm", BOUND, "black")
        axes.set_yscale("log")
        axes.set_title(LAW_TITLES[law])
        axes.set_xlabel("pitch of the tactels (mm)")
        axes.set_ylabel("median position error (mm)")
    panels[0][0].legend(fontsize=6.5)
    return save(figure, folder, "error-density")


def draw_patches(folder: Path) -> list[Path]:
    """Draw the largest rate that a bus of 1 Mbit/s holds against the patches on it, 16-bit and 8-bit."""
    figure, ((axes,),) = new_figure(width=5.6)
    for eds, bits, mark in (("skin-patch", 16, "o"), ("skin-patch-8bit", 8, "s")):
        for delay_us, dash in ((0, "-"), (2000, "--")):
            delays = CycleDelays(response_ns=100_000, compute_ns=1000 * delay_us)
            rates = [
                largest_rate([load_eds(eds, k) for k in range(1, n + 1)], 1_000_000, delays, Beside())
                for n in PATCHES
            ]
            label = f"{bits} bit, {delay_us / 1e3:g} ms to compute"
            axes.plot(PATCHES, rates, dash, marker=mark, ms=3.5, label=label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("patches on the bus")
    axes.set_ylabel("largest SYNC rate that holds (Hz)")
    axes.legend(fontsize=7)
    return save(figure, folder, "rate-patches")


def draw_end_to_end(rows: Sequence[EndToEndRow], folder: Path) -> list[Path]:
    """Draw what the simulated wire measured against the patches on it: latencies, load and error."""
    figure, (panels,) = new_figure(4, width=3.7)
    columns = ("latency_max_ms", "touch_mean_ms", "load_pct", "position_median_mm")
    titles = (
        "sample to last contact TPDO, worst (ms)",
        "touch to last contact TPDO, mean (ms)",
        "load of the bus (%)",
        "median position error (mm)",
    )
    colours = iter(("tab:blue", "tab:orange", "tab:green", "tab:red"))
    for eds, bits, mark in (("skin-patch", 16, "o"), ("skin-patch-8bit", 8, "s")):
        for mode, words in (("sync", "with SYNC"), ("change", "on change")):
            own = [row for row in rows if (row.eds, row.mode) == (eds, mode)]
            n, colour = [row.patches for row in own], next(colours)
            for axes, column in zip(panels, columns, strict=True):
                values = [getattr(row, column) for row in own]
                axes.plot(n, values, "-", marker=mark, ms=3.5, color=colour, label=f"{bits} bit, {words}")
            if mode == "sync":
                bounds = [row.bound_ms for row in own]
                panels[0].plot(n, bounds, "--", color=colour, lw=1, label=f"{bits} bit, bound")
    for axes, title in zip(panels, titles, strict=True):
        axes.set_xscale("log")
        axes.set_xlabel("patches on the bus")
        axes.set_ylabel(title)
        axes.set_yscale("log") if title.endswith("(ms)") else axes.set_ylim(bottom=0.0)
    panels[0].legend(fontsize=7)
    return save(figure, folder, "latency-patches")


def _line(axes: Any, rows: Sequence[Row], x: str, y: str, label: str, colour: str) -> None:
    """Draw the mean over seeds of a column against another."""
    values = sorted({row[x] for row in rows})
    if values:
        means = [_mean([row for row in rows if row[x] == v], y) for v in values]
        axes.plot(values, means, "-", color=colour, marker=MARKERS.get(label, ""), ms=4, label=label)


def _draw_bound(axes: Any, rows: Sequence[Row], style: str) -> None:
    """Draw the median error of an ideal estimate, where more than half of the touches have a bound."""
    least = _mean(rows, "crb_mm")
    if math.isfinite(least):
        axes.axhline(least, color="black", ls=style, lw=1, label=BOUND)


def _some(rows: Sequence[Row], **wanted: Any) -> list[Row]:
    keep: Callable[[Row], bool] = lambda row: all(row[key] == value for key, value in wanted.items())  # noqa: E731
    return [row for row in rows if keep(row)]


def _mean(rows: Sequence[Row], column: str) -> float:
    values = [row[column] for row in rows if np.isfinite(row[column])]
    return float(np.mean(values)) if values else float("nan")
