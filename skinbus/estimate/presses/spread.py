"""Whether presses are enough, and where they must be, to learn a response from."""

from __future__ import annotations

import numpy as np

from skinbus.estimate.calibration import REACH
from skinbus.estimate.presses.table import Ints, PressTable
from skinbus.estimate.response_algebra import POINTS, uncovered

FEWEST, FEWEST_EACH = 30, 10
"""Presses of a kind of board, and of each board: fewer leave the law, or gains, to chance."""
NEAR = 1.25
"""Pitches within which a tactel needs a press, or its gain is not known."""
MOST_BARE = 0.15
"""Part of the tactels of a board that may have none; their gains stay as they are, and are named."""
GAP = 0.35
"""Pitches: the profile of the law is not known where no press has a tactel at such distances."""
WITHIN = 1.2
"""Pitches up to which the profile must be known: places follow from the flank."""
MOST_UNCOVERED = 1.0 / 3.0
"""Part of these distances that may be without readings: thirty presses at random leave a fifth, those on a
grid of two thirds of the pitch two thirds."""
UNEVEN = "press at uneven places, as a grid repeats the same distances to the tactels"


def gaps_of(table: PressTable) -> list[tuple[float, float]]:
    """Return the distances (from, to) m at which no reading determines the law; none where these are few."""
    step, distances, pitches = REACH / (POINTS - 1), [], []
    for p in np.unique(table.patch):
        patch, here = table.arm.patches[p].patch, table.arm.tactels_of(int(p))
        rows = table.patch == p
        d = table.arm.distance(here, table.s[rows], table.a[rows])
        distances.append(d[(d < REACH) & np.isfinite(table.pressures[rows, here])])
        pitches.append(patch.pitch)
    last = int(min(WITHIN * min(pitches), REACH) / step)
    bare = uncovered(np.concatenate(distances), step)[: last + 1] > 0
    if bare.mean() <= MOST_UNCOVERED:
        return []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bare, [False]]).astype(int))).reshape(-1, 2)
    return [(step * max(first - 0.5, 0.0), step * (end - 0.5)) for first, end in edges.tolist()]


def spread_faults(table: PressTable) -> tuple[list[str], list[str]]:
    """Return what is missing, and what is not known but may be so, as sentences."""
    faults: list[str] = []
    notes: list[str] = []
    uv, arm = table.uv(), table.arm
    if len(table) < FEWEST:
        faults.append(f"{len(table)} presses are too few; {FEWEST} are the least, a hundred are plenty")
    distances = []
    for p in range(arm.n_patches):
        patch, rows = arm.patches[p].patch, table.patch == p
        tactels = np.asarray(patch.tactels_uv)
        pitch = patch.pitch
        d = np.hypot(*(uv[rows][:, None] - tactels).T).T / pitch  # (n_rows, n_tactels)
        distances.append(d.ravel())
        near = d < NEAR
        n_on = int((near.any(axis=1)).sum()) if len(d) else 0
        node = f"node {arm.node_label(p)}"
        if n_on < FEWEST_EACH:
            faults.append(f"{n_on} presses on {node} are too few; {FEWEST_EACH} are the least")
            continue
        healthy = np.ones(len(tactels), np.bool_) if patch.healthy is None else np.asarray(patch.healthy)
        unread = np.flatnonzero(~np.isfinite(table.own(p)).any(axis=0) & healthy) + 1
        if len(unread):
            (faults if len(unread) > MOST_BARE * healthy.sum() else notes).append(
                f"no reading of tactel {_some(unread)} of {node}: not calibrated, gains stay as they are; "
                "dead ones are taken out by their bits in 0x2040 (healthy tactels) of the EDS"
            )
        bare = np.flatnonzero(~near.any(axis=0) & healthy) + 1
        if len(bare):
            (faults if len(bare) > MOST_BARE * healthy.sum() else notes).append(
                f"no press within {1e3 * NEAR * pitch:.0f} mm of tactel {_some(bare)} of {node}: "
                "gains there are not known"
            )
    near = np.sort(np.concatenate([[0.0, WITHIN], *distances]))
    near = near[near <= WITHIN]
    widest = int(np.diff(near).argmax())
    if near[widest + 1] - near[widest] > GAP:
        where = "between" if widest else "on"
        faults.append(
            f"no press has a tactel at {near[widest]:.1f} to {near[widest + 1]:.1f} pitches: the law is not "
            f"known there; press {where} the tactels, too"
        )
    gaps = [] if faults else gaps_of(table)
    if gaps:
        where = ", ".join(f"{1e3 * low:.1f} to {1e3 * high:.1f}" for low, high in gaps)
        notes.append(
            f"no press has a tactel at distances of {where} mm: there the law is drawn, not measured; "
            f"{UNEVEN}"
        )
    return faults, notes


def _some(numbers: Ints) -> str:
    """Return the first ten numbers in words."""
    return ", ".join(map(str, numbers[:10].tolist())) + (" and others" if len(numbers) > 10 else "")
