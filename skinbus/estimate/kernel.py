"""How every kernel is compiled: cached, without the GIL, exact arithmetic; dividing by 0 gives infinity."""

from __future__ import annotations

from numba import njit

kernel = njit(cache=True, nogil=True, fastmath=False, error_model="numpy")
