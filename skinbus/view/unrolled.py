"""The arm unrolled in the terminal: tactels shaded by pressure, contacts and true touches marked."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.text import Text

from skinbus.model import Arm

CELL_S, CELL_A = 0.010, 0.005
"""Size of one character on the surface, m: characters are about twice as high as wide."""

SHADES = " ·:-=+*#%@"
STYLES = ("grey50", "grey50", "blue", "blue", "cyan", "green", "yellow", "orange1", "red", "bold red")
LOST, LOST_STYLE = "x", "red"
CONTACT_STYLE, TRUTH_STYLE = "bold black on green", "bold white on magenta"


class Unrolled:
    """One character grid per link: s runs down, a to the right."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._grids = [_Grid(arm, link) for link in range(len(arm.links))]

    def render(
        self,
        pressures: npt.NDArray[np.float64],
        full_scale: float,
        contacts: Iterable[tuple[int, float, float, str]] = (),
        truth: Iterable[tuple[int, float, float]] = (),
        lost: npt.NDArray[np.bool_] | None = None,
    ) -> Text:
        """Return the picture; contacts are (link, s, a, label), true touches (link, s, a).

        ``lost`` (n_tactels,) have no fresh readings: their pressure is not known, and is not shown as zero.
        """
        level = np.clip(pressures / full_scale, 0.0, 1.0) * (len(SHADES) - 1)
        # Square root: a light touch is seen beside a hard one.
        shade = np.ceil(np.sqrt(level / (len(SHADES) - 1)) * (len(SHADES) - 1)).astype(int)
        text = Text()
        marks: dict[tuple[int, int, int], tuple[str, str]] = {}
        for link, s, a in truth:
            marks[(link, *self._grids[link].cell(s, a))] = ("+", TRUTH_STYLE)
        for link, s, a, label in contacts:
            marks[(link, *self._grids[link].cell(s, a))] = (label[-1], CONTACT_STYLE)
        for link, grid in enumerate(self._grids):
            if len(self._grids) > 1:
                text.append(f"{self._arm.links[link].name}\n", style="bold")
            for r, row in enumerate(grid.tactel):
                for c, tactel in enumerate(row):
                    mark = marks.get((link, r, c))
                    if mark:
                        text.append(*mark)
                    elif tactel < 0:
                        text.append(" ")
                    elif lost is not None and lost[tactel]:
                        text.append(LOST, style=LOST_STYLE)
                    else:
                        text.append(
                            SHADES[shade[tactel]] if shade[tactel] else "·", style=STYLES[shade[tactel]]
                        )
                text.append("\n")
        return text


class _Grid:
    """Cells of one link, each with the tactel that covers it or -1."""

    def __init__(self, arm: Arm, link: int) -> None:
        surface = arm.links[link].surface
        tactels = np.flatnonzero(arm.tactel_link == link)
        s, a = arm.tactel_s[tactels], arm.tactel_a[tactels]
        radius = max((p.patch.diameter for p in arm.patches if p.link == link), default=0.01) * 0.6
        self._s0 = float(s.min(initial=0.0)) - radius
        self._a0 = -0.5 * surface.period if surface.period else float(a.min(initial=0.0)) - radius
        width = surface.period or float(a.max(initial=0.0)) + radius - self._a0
        shape = (
            int(np.ceil((float(s.max(initial=0.0)) + radius - self._s0) / CELL_S)),
            int(np.ceil(width / CELL_A)),
        )
        self.tactel: Any = np.full(shape, -1)
        if len(tactels):
            cell_s = self._s0 + (np.arange(shape[0]) + 0.5) * CELL_S
            cell_a = self._a0 + (np.arange(shape[1]) + 0.5) * CELL_A
            d = surface.distance(cell_s[:, None, None], cell_a[None, :, None], s, a)
            nearest = d.argmin(-1)
            self.tactel = np.where(d.min(-1) <= radius, tactels[nearest], -1)
        self._surface = surface

    def cell(self, s: float, a: float) -> tuple[int, int]:
        """Return the cell (row, column) of a point, clipped to the picture."""
        row = int((s - self._s0) / CELL_S)
        column = int((float(self._surface.wrap(a)) - self._a0) / CELL_A)
        rows, columns = self.tactel.shape
        return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
