"""The arm unrolled in the terminal: tactels shaded by pressure, contacts and true touches marked."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from rich.text import Text
from scipy.spatial.distance import pdist

from skinbus.model import Arm

CELL_S: Final = 0.010
CELL_A: Final = 0.005
"""Size of one character on the surface, m: characters are about twice as high as wide. Where tactels are
closer, or a link is too wide for the terminal, it is another: every tactel has a character of its own."""

SHADES = " ·:-=+*#%@"
STYLES = ("grey50", "grey50", "blue", "blue", "cyan", "green", "yellow", "orange1", "red", "bold red")
_SIGNS: Final = np.array(list(zip("·" + SHADES[1:], STYLES, strict=True)), object)
LOST, LOST_STYLE = "x", "red"
CONTACT_STYLE, TRUTH_STYLE = "bold black on green", "bold white on magenta"


class Unrolled:
    """One character grid per link: s runs down, a to the right."""

    def __init__(self, arm: Arm, width: int = 1000) -> None:
        """Draw an arm for a terminal of a width, in characters."""
        self._arm = arm
        boards = {id(p.patch): p.patch.tactels_uv for p in arm.patches if p.patch.n_tactels > 1}
        pitch = max(min((float(pdist(uv).min()) for uv in boards.values()), default=CELL_S), 1e-3)
        widest = max(link.surface.width for link in arm.links)
        self._grids = [
            _Grid(arm, link, min(CELL_S, pitch), min(max(CELL_A, widest / (width - 1)), pitch))
            for link in range(len(arm.links))
        ]
        self.size = (
            max(grid.tactel.shape[1] for grid in self._grids),
            sum(len(grid.tactel) for grid in self._grids) + (len(self._grids) if len(self._grids) > 1 else 0),
        )
        """Characters in a line, and lines."""

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
        # Square root: a light touch is seen beside a hard one.
        shade = np.sqrt(np.clip(np.asarray(pressures) / full_scale, 0.0, 1.0)) * (len(SHADES) - 1)
        signs, styles = _SIGNS[np.ceil(shade).astype(int)].T  # one more, that of no tactel: index -1
        signs, styles = np.append(signs, " "), np.append(styles, "")
        if lost is not None:
            signs[:-1][lost], styles[:-1][lost] = LOST, LOST_STYLE
        drawn = [(signs[grid.tactel], styles[grid.tactel]) for grid in self._grids]
        for link, s, a in truth:
            at = self._grids[link].cell(s, a)
            drawn[link][0][at], drawn[link][1][at] = "+", TRUTH_STYLE
        for link, s, a, label in contacts:
            row, column = self._grids[link].cell(s, a)
            column = max(min(column, drawn[link][0].shape[1] - len(label)), 0)
            here = row, slice(column, column + len(label))
            drawn[link][0][here], drawn[link][1][here] = list(label), CONTACT_STYLE
        text = Text()
        for k, (letters, looks) in enumerate(drawn):
            if len(drawn) > 1:
                text.append(f"{self._arm.links[k].name}\n", style="bold")
            for line in zip(letters, looks, strict=True):
                for letter, look in zip(*line, strict=True):
                    text.append(letter, style=look)
                text.append("\n")
        return text


class _Grid:
    """Cells of one link, each with the tactel that covers it or -1."""

    def __init__(self, arm: Arm, link: int, cell_s: float, cell_a: float) -> None:
        self._cell = cell_s, cell_a
        self._surface = surface = arm.links[link].surface
        tactels = np.flatnonzero(arm.tactel_link == link)
        if not len(tactels):
            self.tactel: Any = np.full((1, 1), -1)
            self._low = 0.0, 0.0
            return
        s, a = arm.tactel_s[tactels], arm.tactel_a[tactels]
        radius = 0.6 * max(p.patch.diameter for p in arm.patches if p.link == link)
        ends_a = (
            (-0.5 * surface.period, 0.5 * surface.period)
            if surface.period
            else (a.min() - radius, a.max() + radius)
        )
        self._low = s.min() - radius, ends_a[0]
        at_s = np.arange(self._low[0] + 0.5 * cell_s, s.max() + radius + 0.5 * cell_s, cell_s)
        at_a = np.arange(ends_a[0] + 0.5 * cell_a, ends_a[1] + 0.5 * cell_a, cell_a)
        along = np.abs(at_s[:, None, None] - s)
        d = np.maximum(along, np.abs(surface.wrap(at_a[None, :, None] - a)))  # a tactel covers a square
        self.tactel = np.where(d.min(-1) <= radius, tactels[d.argmin(-1)], -1)
        self.tactel[self._cells(s, a)] = tactels  # one may be nearest to no character

    def cell(self, s: float, a: float) -> tuple[int, int]:
        """Return the cell (row, column) of a point, clipped to the picture."""
        row, column = self._cells(np.array(s), np.array(a))
        return int(row), int(column)

    def _cells(self, s: npt.NDArray[np.float64], a: npt.NDArray[np.float64]) -> tuple[Any, Any]:
        rows, columns = self.tactel.shape
        row = ((s - self._low[0]) / self._cell[0]).astype(int)
        column = ((self._surface.wrap(a) - self._low[1]) / self._cell[1]).astype(int)
        return np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)
