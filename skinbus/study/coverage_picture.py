"""The picture of a coverage: the links unrolled, what is felt in colour, bare skin hatched."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from skinbus.study.coverage import Coverage

PANELS = (
    ("least force, N", "least_force", 1.0, (0.01, 10.0)),
    ("standard deviation of place, mm", "sd_place", 1e3, (0.05, 10.0)),
    ("standard deviation of force, N", "sd_force", 1.0, (0.02, 5.0)),
)
"""Title, column, unit, and what the colours span: values beyond are as the end."""


def draw(coverage: Coverage, path: Path) -> None:
    """Write the picture: a row for each link, a column for each quantity."""
    links = coverage.arm.links
    figure = Figure(figsize=(13.0, 1.0 + 3.2 * len(links)), layout="constrained")
    axes = figure.subplots(len(links), len(PANELS), squeeze=False)
    for k, link in enumerate(links):
        surface = link.surface
        extent = (-0.5e3 * surface.width, 0.5e3 * surface.width, 0.0, 1e3 * surface.length)
        for axis, (title, name, unit, span) in zip(axes[k], PANELS, strict=True):
            values = coverage.grid(k, unit * getattr(coverage, name))
            shown = np.clip(values, *span)  # infinity is at the end, too
            image = axis.imshow(
                shown, origin="lower", extent=extent, aspect="equal", cmap="viridis_r", norm=LogNorm(*span)
            )
            board = coverage.grid(k, coverage.board)
            s = (np.arange(board.shape[0]) + 0.5) / board.shape[0] * extent[3]
            a = extent[0] + (np.arange(board.shape[1]) + 0.5) / board.shape[1] * (extent[1] - extent[0])
            if (board < 0).any() and min(board.shape) > 1:
                axis.contourf(a, s, board < 0, levels=[0.5, 1.5], colors="none", hatches=["////"])
            axis.set_title(f"{link.name}: {title}", fontsize=9)
            axis.set_xlabel("a, mm", fontsize=8)
            axis.set_ylabel("s, mm", fontsize=8)
            axis.tick_params(labelsize=7)
            figure.colorbar(image, ax=axis, shrink=0.8)
    figure.savefig(path, dpi=150)
