"""The arm unrolled in the terminal: tactels shaded by pressure, contacts and true touches marked."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from rich.text import Text
from scipy.spatial.distance import pdist

from skinbus.arrays import Floats
from skinbus.model import Arm
from skinbus.skin.cycle import Cycle

CELL_S = 0.010
CELL_A = 0.005
"""Size of one character on the surface, m: characters are about twice as high as wide. Where tactels are
closer, or a link is too wide for the terminal, it is another: every tactel is one character."""
FULL_SHADE_PA = 60e3
"""Pressure shown darkest: the peak of a 5 N fingertip on the default layer is about 40 kPa."""

LOST = "x"
SHADES = "··:-=+*#%@"
_SIGNS = np.array(
    [
        *zip(
            SHADES,
            ("grey50", "grey50", "blue", "blue", "cyan", "green", "yellow", "orange1", "red", "bold red"),
            strict=True,
        ),
        (LOST, "red"),
        (" ", ""),
    ],
    object,
)
"""Letters and styles of pressures, of a tactel without a reading that is used, and of no tactel."""
CONTACT_STYLE = "bold black on green"
TRUTH = ("+", "bold white on magenta")


class Unrolled:
    """One character grid per link: s runs down, a to the right."""

    def __init__(self, arm: Arm, width: int) -> None:
        """Draw an arm for a terminal of a width, in characters."""
        boards = {id(p.patch): p.patch.tactels_uv for p in arm.patches if p.patch.n_tactels > 1}
        pitch = max(min((float(pdist(uv).min()) for uv in boards.values()), default=CELL_S), 1e-3)
        widest = max(link.surface.width for link in arm.links)
        cell = min(CELL_S, pitch), min(max(CELL_A, widest / (width - 1)), pitch)
        self._grids = {link.name: _Grid(arm, k, cell) for k, link in enumerate(arm.links)}
        rows, columns = zip(*(grid.tactel.shape for grid in self._grids.values()), strict=True)
        self._has_names = len(rows) > 1
        self.size = max(columns), sum(rows) + len(rows) * self._has_names
        """Characters in a line, and lines."""

    def render(self, cycle: Cycle) -> Text:
        """Return the picture of a cycle; a pressure that is not known is not shown as zero."""
        # Square root: a light touch is seen beside a hard one.
        shade = np.sqrt(np.clip(cycle.readings.pressures / FULL_SHADE_PA, 0.0, 1.0)) * (len(SHADES) - 1)
        signs = np.append(np.where(cycle.readings.valid, np.ceil(shade).astype(int), len(SHADES)), -1)
        drawn = {name: _SIGNS[signs[grid.tactel]] for name, grid in self._grids.items()}
        for touch in cycle.truth:
            drawn[touch.link][self._grids[touch.link].cells(touch.s, touch.a)] = TRUTH
        for contact in cycle.contacts:
            row, column = self._grids[contact.link].cells(contact.s, contact.a)
            picture, label = drawn[contact.link], str(contact.id)
            begin = max(min(int(column), picture.shape[1] - len(label)), 0)
            picture[row, begin : begin + len(label)] = [(letter, CONTACT_STYLE) for letter in label]
        text = Text()
        for name, picture in drawn.items():
            if self._has_names:
                text.append(f"{name}\n", style="bold")
            for line in picture.tolist():
                text.append_text(Text.assemble(*map(tuple, line), "\n"))
        return text


class _Grid:
    """Cells of one link, each with the tactel whose middle is in it or -1."""

    def __init__(self, arm: Arm, link: int, cell: tuple[float, float]) -> None:
        self._cell, self._surface = cell, arm.links[link].surface
        self.tactel: npt.NDArray[Any] = np.full((1, 1), -1)
        self._low: Floats = np.zeros(2)
        tactels = np.flatnonzero(arm.tactel_link == link)
        if not len(tactels):
            return
        places = np.stack([arm.tactel_s, arm.tactel_a])[:, tactels]
        self._low, high = places.min(1) - 0.5 * np.array(cell), places.max(1) + 0.5 * np.array(cell)
        if half := 0.5 * self._surface.period:
            self._low[1], high[1] = -half, half
        shape = np.maximum(np.rint((high - self._low) / cell), 1.0).astype(int)
        self.tactel = np.full(shape, -1)
        self.tactel[self.cells(*places)] = tactels

    def cells(self, s: npt.ArrayLike, a: npt.ArrayLike) -> tuple[Any, Any]:
        """Return the cells (rows, columns) of points, clipped to the picture."""
        steps = np.array([s, self._surface.wrap(np.asarray(a))]).T - self._low
        row, column = (steps / self._cell).astype(int).T
        n_rows, n_columns = self.tactel.shape
        return np.clip(row, 0, n_rows - 1), np.clip(column, 0, n_columns - 1)
