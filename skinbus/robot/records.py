"""Kernel: contacts on the robot into the float32 members of contact records and the objects beside them."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from skinbus.jit import inner_kernel, kernel
from skinbus.robot.kernels import BASE, TOOL

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

LARGEST = float(np.finfo(np.float32).max)
"""What does not fit into a REAL32 is this, not infinite."""


@inner_kernel
def single(value: float) -> np.float32:
    """Return a value as REAL32; NaN, not known, as 0."""
    if value != value:
        return np.float32(0.0)
    return np.float32(min(max(value, -LARGEST), LARGEST))


@kernel
def write_records(
    rows: Ints,
    slots: Ints,
    point: Floats,
    normal: Floats,
    covariance: Floats,
    force: Floats,
    positions: Floats,
    torques: Floats,
    torque_covariance: Floats,
    wrench: Floats,
    torque_step: float,
    torque_most: float,
    block: npt.NDArray[np.float32],
    valid: npt.NDArray[np.uint8],
    position_out: npt.NDArray[np.float32],
    torque_out: npt.NDArray[np.float32],
    deviation_out: npt.NDArray[np.float32],
    wrench_out: npt.NDArray[np.float32],
    counts_out: npt.NDArray[np.int16],
) -> None:
    """Write the contacts in ``rows`` to the records in ``slots``, and what all contacts do to the robot.

    Rows and slots of less than 0 are those of no contact, or no record: they are passed over.

    block  (n_records, 24): in the base point, normal, force, covariance (xx xy xz yy yz zz); then in the tool
           point, normal, force
    valid  (n_records,) 1 of the records that are written, 0 of all others
    """
    valid[:] = 0  # a place of a contact that is not seen now would be that of another pose
    for i in range(len(rows)):
        c, k = rows[i], slots[i]
        if c < 0 or k < 0:
            continue
        valid[k] = 1
        for x in range(3):
            block[k, x] = single(point[c, BASE, x])
            block[k, 3 + x] = single(normal[c, BASE, x])
            block[k, 6 + x] = single(-force[c] * normal[c, BASE, x])
            block[k, 15 + x] = single(point[c, TOOL, x])
            block[k, 18 + x] = single(normal[c, TOOL, x])
            block[k, 21 + x] = single(-force[c] * normal[c, TOOL, x])
        m = 9
        for x in range(3):
            for y in range(x, 3):
                block[k, m] = single(covariance[c, BASE, x, y])
                m += 1
    for j in range(len(torques)):
        position_out[j] = single(positions[j])
        torque_out[j] = single(torques[j])
        variance = torque_covariance[j, j]
        deviation_out[j] = single(math.sqrt(variance) if variance > 0.0 else 0.0)
        counts = np.rint(torques[j] / torque_step)
        counts_out[j] = np.int16(min(max(counts, -torque_most), torque_most))
    for x in range(6):
        wrench_out[x] = single(wrench[x])
