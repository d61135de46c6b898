"""Presses as they were recorded: one by one, and as tables of boards of a kind, which share a law."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Bools, Floats
from skinbus.model import Arm

Ints = npt.NDArray[np.intp]


class Press(NamedTuple):
    """What one patch reads under one press."""

    patch: int
    s: float
    a: float
    force: float
    """N; NaN where it is not known, 0 where nothing touches."""
    readings: Floats
    """(n_tactels of the patch,) Pa; NaN for a missing one."""
    line: int = 0
    """Of the file, for messages."""
    noise: Floats | None = None
    """(n_tactels of the patch,) Pa, what single readings scattered by; NaN where that is not known."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressTable:
    """One row is what one patch reads under one press.

    arm        the patches pressed, all of one kind
    patch      (n,) index of the patch that was read
    s, a       (n,) m, where the press is said to be, on the chart of its link
    force      (n,) N; None where it is not known, but the same in all
    pressures  (n, n_tactels) Pa, as the arm's gains give them; NaN for other patches and missing readings
    noise      (n, n_tactels) Pa, what single readings scattered by in a press; NaN where it is not known
    """

    arm: Arm
    patch: Ints
    s: Floats
    a: Floats
    force: Floats | None
    pressures: Floats
    noise: Floats | None = None

    def __len__(self) -> int:
        return len(self.s)

    def only(self, rows: Bools | Ints) -> PressTable:
        """Return some of the rows."""
        columns = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "arm"}
        return replace(self, **{name: column[rows] for name, column in columns.items() if column is not None})

    @property
    def link(self) -> Ints:
        """(n,) index of the link."""
        return np.asarray(self.arm.patch_link[self.patch], np.intp)

    @property
    def pitch(self) -> float:
        """Of the tactels, m."""
        return self.arm.patches[0].patch.pitch

    def uv(self, s: Floats | None = None, a: Floats | None = None) -> Floats:
        """Return places on the chart in the frames of the boards, (n, 2) m; those of the table by default."""
        s, a = self.s if s is None else s, self.a if a is None else a
        out = np.zeros((len(self), 2))
        for p in np.unique(self.patch):
            rows = self.patch == p
            out[rows] = self.arm.on_board(int(p), s[rows], a[rows])
        return out

    def away(self) -> Floats:
        """Return the distances of presses from tactels, (n, n_tactels) m; infinite from other patches."""
        d = np.full(self.pressures.shape, np.inf)
        for p in np.unique(self.patch).tolist():
            rows, here = np.flatnonzero(self.patch == p), self.arm.tactels_of(p)
            d[rows, here] = self.arm.distance(here, self.s[rows], self.a[rows])
        return d


def tables_of(arm: Arm, presses: Sequence[Press]) -> Iterator[tuple[PressTable, Ints]]:
    """Yield the presses of each kind of board as a table, with the line of each press.

    Boards are of a kind when they have the same tactels behind the same transducers: they share a law.
    """
    kinds: dict[tuple[Any, ...], list[int]] = {}
    for p in sorted({press.patch for press in presses}):
        kinds.setdefault(kind_of(arm, p), []).append(p)
    for patches in kinds.values():
        part = Arm(arm.name, arm.links, [arm.patches[p] for p in patches], *arm.buses)
        rows = [press for press in presses if press.patch in patches]
        patch = np.array([patches.index(press.patch) for press in rows], np.intp)
        pressures, noise = np.full((2, len(rows), part.n_tactels), np.nan)
        for k, press in enumerate(rows):
            here = part.tactels_of(int(patch[k]))
            pressures[k, here] = press.readings
            noise[k, here] = np.nan if press.noise is None else press.noise
        s, a, force = np.array([(press.s, press.a, press.force) for press in rows]).T
        table = PressTable(
            arm=part,
            patch=patch,
            s=s,
            a=a,
            force=None if np.isnan(force[0]) else force,
            pressures=pressures,
            noise=noise,
        )
        yield table, np.array([press.line for press in rows], np.intp)


def kind_of(arm: Arm, p: int) -> tuple[Any, ...]:
    """Return what boards of a kind have in common; a mirrored board is of the kind of the others."""
    patch = arm.patches[p].patch
    uv = patch.tactels_uv
    either = min(((uv * sign) + 0.0).tobytes() for sign in ((1.0, 1.0), (1.0, -1.0)))  # no -0.0
    return either, patch.diameter, patch.size, patch.transducer


def mean_and_noise(cycles: Floats) -> tuple[Floats, Floats]:
    """Return means and standard deviations of readings over cycles (n, n_tactels), (n_tactels,) Pa each.

    NaN in readings is left out; the mean of none is NaN, and so is the standard deviation of less than two.
    """
    read = np.ma.masked_invalid(cycles)
    return read.mean(axis=0).filled(np.nan), read.std(axis=0, ddof=1).filled(np.nan)
