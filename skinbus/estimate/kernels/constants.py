"""Numbers that several kernels share."""

from __future__ import annotations

FEW_TACTELS = 1
FULL_SCALE = 2
NOT_CONVERGED = 4
BAD_FIT = 8
OVER_BUDGET = 16
"""Bits of the quality of a contact; ``contacts.Quality`` explains them."""
