"""Where the presses put a board, relative to where the arm file has it: shift, yaw, scale.

A law that is radial about each tactel cannot hide a shift: estimates then deviate from the places said by the
same step everywhere. The deviations are fitted by a shift and a matrix, with weights that outliers lose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinbus.estimate.presses.cross_validation import HeldOutErrors
from skinbus.estimate.presses.table import Floats, PressTable

FEWEST = 12
"""Presses below which the pose of a board is not fitted: six numbers from 24."""
SURE = 4.0
"""Standard deviations from which a pose is called wrong."""
LIMIT_M, NOTE_M = 0.5e-3, 0.15e-3
"""m, by which a board may lie elsewhere without a fault, and without a note: half of the error that is
refused, and what presses by a robot show."""
HUBER = 1.5


@dataclass(frozen=True, slots=True)
class Pose:
    """Of one patch: a shift (m) with its standard deviation, a turn (rad) and a scale."""

    shift: tuple[float, float]
    sd: float
    yaw: float
    scale: float
    fault: str = ""
    note: str = ""


def find_poses(table: PressTable, errors: HeldOutErrors) -> list[Pose]:
    """Return the poses of the patches with presses enough; ``errors`` are those of a law without a map."""
    poses = []
    uv = table.uv()
    for p in np.unique(table.patch):
        rows = np.flatnonzero((table.patch == p) & errors.found)
        patch = table.arm.patches[p].patch
        tactels = np.asarray(patch.tactels_uv)
        if len(rows) < FEWEST or len(tactels) < 3:
            continue
        poses.append(_fitted(table.arm.node_label(int(p)), uv[rows], errors.uv[rows], tactels, patch.pitch))
    return poses


def _fitted(node: str, at: Floats, off: Floats, tactels: Floats, pitch: float) -> Pose:
    """Return the pose for deviations ``off`` (n, 2) m at places (n, 2) m."""
    rows = np.column_stack([np.ones(len(at)), at])
    weight = np.ones(len(at))
    for _ in range(10):
        inverse = np.linalg.pinv(rows.T @ (rows * weight[:, None]))
        fitted = inverse @ (rows.T @ (off * weight[:, None]))
        left = np.hypot(*(off - rows @ fitted).T)
        spread = max(1.2 * float(np.median(left)), 1e-9)
        weight = np.minimum(1.0, HUBER * spread / np.maximum(left, 1e-12))
    shift, matrix = fitted[0], fitted[1:].T
    sd = spread * float(np.sqrt(inverse[0, 0]))
    yaw, scale = 0.5 * (matrix[1, 0] - matrix[0, 1]), 0.5 * (matrix[0, 0] + matrix[1, 1])
    half = 0.5 * float(np.hypot(*np.ptp(tactels, axis=0)))
    rim, turn = half * float(np.abs(matrix).max()), half * abs(yaw)
    sd_rim = half * spread * float(np.sqrt(np.diag(inverse)[1:].max()))
    shifted = float(np.hypot(*shift))
    limit = max(LIMIT_M, 0.05 * pitch)
    text = (
        f"the readings of node {node} lie {1e3 * shift[0]:+.2f} mm in u and {1e3 * shift[1]:+.2f} mm in v "
        f"(sd {1e3 * sd:.2f} mm) from where the presses are said to be, turned by {np.degrees(yaw):+.1f} "
        f"degrees, scale {1.0 + scale:.3f}"
    )
    # a scale is no error of mounting: coarse readings make one; the error to expect says whether it matters
    wrong = (shifted > limit and shifted > SURE * sd) or (turn > 2.0 * limit and turn > SURE * sd_rim)
    noted = (shifted > NOTE_M and shifted > SURE * sd) or (rim > limit and rim > SURE * sd_rim)
    fault = f"{text}: either these places or that of the board in the arm file are wrong" if wrong else ""
    return Pose(
        (float(shift[0]), float(shift[1])),
        sd,
        float(yaw),
        1.0 + float(scale),
        fault,
        text if noted and not wrong else "",
    )
