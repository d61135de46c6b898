"""What all pictures of the study share: one look, one colour for each level, PNG and SVG from one call."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
from matplotlib.figure import Figure

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
    files = [folder / f"{name}.png", folder / f"{name}.svg"]
    with mpl.rc_context(_STYLE):
        figure.savefig(files[0], dpi=130)
        figure.savefig(files[1], metadata={"Date": None})
    return files
