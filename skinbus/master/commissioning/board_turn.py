"""How a board is turned, and whether it is mirrored, from presses at its centre and at two of its corners."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

CORNERS: Final = (complex(1, 1), complex(-1, 1))
"""The two that are pressed after the centre, in halves of the size of a board: they are not opposite, so
that a mirrored board differs from a turned one."""
INSIDE: Final = 0.7
"""Part of the way to a corner where a finger presses: on tactels of the board, none of a neighbour."""

SNAP: Final = math.radians(20.0)
"""A board is mounted as planned or by quarters of a turn from it; fingers a third of a pitch off, 5 mm at
18 mm from the centre, err by less."""
FITS: Final = 0.9
"""Correlation from which presses have the shape of the points that were asked for; ..."""
MIRRORED_FITS_LESS: Final = 0.2
"""... by so much at least more than those of the mirrored board, whose is 0.5."""


class Turn(NamedTuple):
    """How a board sits."""

    yaw: float
    """rad, in (-pi, pi]"""
    mirrored: bool
    is_snapped: bool
    """Whether it is by quarters of a turn from the planned one, and was taken for exact."""


def corner(size: tuple[float, float], yaw: float, which: int) -> complex:
    """Return where a corner is pressed: from the centre along s, and i times across, m."""
    c = CORNERS[which]
    return 0.5 * INSIDE * complex(c.real * size[0], c.imag * size[1]) * complex(math.cos(yaw), math.sin(yaw))


def fit_turn(felt: Sequence[complex], pressed: Sequence[complex], planned: float) -> Turn | None:
    """Return how a board sits that felt presses at u + iv where it was pressed at s + ia; None if unclear.

    Scale does not matter: a centre of pressure lies further in than the finger.
    """
    own, target = np.asarray(felt), np.asarray(pressed)
    target = target - target.mean()
    best: list[tuple[float, float, bool]] = []
    for mirrored in (False, True):
        x = np.conj(own) if mirrored else own
        x = x - x.mean()
        product = complex(np.vdot(x, target))
        norm = float(np.linalg.norm(x) * np.linalg.norm(target))
        best.append((abs(product) / max(norm, 1e-300), math.atan2(product.imag, product.real), mirrored))
    best.sort(reverse=True)
    (fit, yaw, mirrored), (other, *_) = best
    if fit < FITS or fit - other < MIRRORED_FITS_LESS:
        return None
    quarter = planned + 0.5 * math.pi * round((yaw - planned) / (0.5 * math.pi))
    is_snapped = abs(yaw - quarter) <= SNAP
    yaw = quarter if is_snapped else math.radians(round(math.degrees(yaw)))
    yaw = -((math.pi - yaw) % math.tau - math.pi)  # in (-pi, pi]
    return Turn(yaw if abs(yaw) > 1e-12 else 0.0, mirrored, is_snapped)
