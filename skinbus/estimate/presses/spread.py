"""Whether presses are enough, and where they must be, to learn a response from."""

from __future__ import annotations

import numpy as np

from skinbus.estimate.presses.table import PressTable, pitch_of

FEWEST, FEWEST_EACH = 30, 10
"""Presses of a kind of board, and of each board: fewer leave the law, or gains, to chance."""
NEAR = 1.25
"""Pitches within which a tactel needs a press, or its gain is not known."""
MOST_BARE = 0.15
"""Part of the tactels of a board that may have none; their gains stay as they are, and are named."""
GAP = 0.35
"""Pitches: the profile of the law is not known where no press has a tactel at such distances."""
WITHIN = 1.2
"""Pitches up to which the profile must be known: places are told by the flank."""


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
        pitch = pitch_of(tactels, patch.diameter)
        d = np.hypot(*(uv[rows][:, None] - tactels).T).T / pitch  # (n_rows, n_tactels)
        distances.append(d.ravel())
        near = d < NEAR
        n_on = int((near.any(axis=1)).sum()) if len(d) else 0
        node = f"node {arm.node_id[p]}"
        if n_on < FEWEST_EACH:
            faults.append(f"{n_on} presses on {node} are too few; {FEWEST_EACH} are the least")
            continue
        healthy = np.ones(len(tactels), np.bool_) if patch.healthy is None else np.asarray(patch.healthy)
        bare = np.flatnonzero(~near.any(axis=0) & healthy) + 1
        if len(bare):
            some = ", ".join(map(str, bare[:10])) + (" and others" if len(bare) > 10 else "")
            (faults if len(bare) > MOST_BARE * healthy.sum() else notes).append(
                f"no press within {1e3 * NEAR * pitch:.0f} mm of tactel {some} of {node}: "
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
    return faults, notes
