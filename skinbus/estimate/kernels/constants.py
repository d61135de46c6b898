"""Numbers that several kernels share."""

from __future__ import annotations

from typing import Final

FEW_TACTELS: Final = 1
FULL_SCALE: Final = 2
NOT_CONVERGED: Final = 4
BAD_FIT: Final = 8
OVER_BUDGET: Final = 16
"""Bits of the quality of a contact; ``contacts.Quality`` explains them."""
