"""What all pictures of the study share: one look, one colour for each level, PNG and SVG from one call."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

COLOURS: Final = {
    "kmeans": "tab:orange",
    "fit": "tab:blue",
    "full": "tab:green",
    "paper's K-means": "tab:pink",
    "scipy kmeans2": "tab:red",
    "scikit-learn KMeans": "tab:purple",
    "CRB": "black",
}
"""Colour of each level, and of what it is compared with."""
MARKERS: Final = {
    "kmeans": "o",
    "fit": "s",
    "full": "D",
    "paper's K-means": "P",
    "scipy kmeans2": "v",
    "scikit-learn KMeans": "^",
    "CRB": "",
}

_STYLE: Final[Any] = {
    "figure.dpi": 110,
    "font.size": 9,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    # the same numbers give the same file
    "svg.hashsalt": "skinbus",
}


def new_figure(
    columns: int = 1, rows: int = 1, *, width: float = 5.0, height: float = 3.6
) -> tuple[Figure, Any]:
    """Return a figure and its axes, (rows, columns)."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
        return figure, figure.subplots(rows, columns, squeeze=False)


def save(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a figure as PNG and SVG; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        if axis.get_scale() == "log":
            _name_ticks(axis)
    files = [folder / f"{name}.png", folder / f"{name}.svg"]
    with mpl.rc_context(_STYLE):
        figure.savefig(files[0], dpi=130)
        figure.savefig(files[1], metadata={"Date": None})
    return files


def _name_ticks(axis: Any) -> None:
    """Write 0.2 and 50 beside the ticks of a short logarithmic axis, where powers of ten would be too few."""
    low, high = axis.get_view_interval()
    if high < 1000.0 * low:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
