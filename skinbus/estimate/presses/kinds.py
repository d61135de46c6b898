"""Presses one by one, and as tables of boards of a kind, which share a law."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from skinbus.estimate.presses.table import Floats, Ints, PressTable
from skinbus.model import Arm


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
    is_single: bool = False
    """Whether these are single readings, not means over cycles."""


def tables_of(arm: Arm, presses: Sequence[Press]) -> list[tuple[PressTable, Ints]]:
    """Return the presses of each kind of board as a table, with the patches of the arm that it has.

    Boards are of a kind when they have the same tactels behind the same transducers: they share a law.
    """
    kinds: dict[tuple[Any, ...], list[int]] = {}
    for p in sorted({press.patch for press in presses}):
        kinds.setdefault(kind_of(arm, p), []).append(p)
    tables = []
    for patches in kinds.values():
        part = Arm(arm.name, arm.links, [arm.patches[p] for p in patches], *arm.buses)
        rows = [press for press in presses if press.patch in patches]
        pressures = np.full((len(rows), part.n_tactels), np.nan)
        patch = np.array([patches.index(press.patch) for press in rows], np.intp)
        noise = np.full_like(pressures, np.nan)
        for row, scatter, p, press in zip(pressures, noise, patch, rows, strict=True):
            row[part.tactels_of(int(p))] = press.readings
            if press.noise is not None:
                scatter[part.tactels_of(int(p))] = press.noise
        s, a, force = (np.array([getattr(press, name) for press in rows]) for name in ("s", "a", "force"))
        table = PressTable(
            arm=part,
            patch=patch,
            s=s,
            a=a,
            force=None if np.isnan(force[0]) else force,
            pressures=pressures,
            noise=noise if np.isfinite(noise).any() else None,
            are_single=all(press.is_single for press in rows),
        )
        tables.append((table, np.array([press.line for press in rows], np.intp)))
    return tables


def kind_of(arm: Arm, p: int) -> tuple[Any, ...]:
    """Return what boards of a kind have in common; a mirrored board is of the kind of the others."""
    patch = arm.patches[p].patch
    uv = np.asarray(patch.tactels_uv)
    either = min(((uv * sign) + 0.0).tobytes() for sign in ((1.0, 1.0), (1.0, -1.0)))  # no -0.0
    return either, patch.diameter, patch.size, patch.transducer
