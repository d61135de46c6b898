"""Numbers that several kernels share."""

from __future__ import annotations

from typing import Final

MAX_MOVE: Final = 0.01
"""One step of a fit on the surface, m: a pitch of the usual board."""
SPLIT_OFFSETS: Final = (0.004, 0.009, 0.014)
"""m: the ends of the range over which two contacts look like one on the usual board, from its middle."""
FORCE_PRIOR: Final = -1.0
"""Power of the force in the prior of its logarithm: small forces are commoner than large ones. It decides
between a touch on the skin and one so far off its tactels that they feel only its flank."""
FORCE_WIDTH: Final = 1.0
"""Standard deviation of the prior of log force: a factor e. Loads of one use of a skin (a hand, a tip) vary
by as much; it decides only where readings leave a factor of several open."""

FEW_TACTELS: Final = 1
FULL_SCALE: Final = 2
NOT_CONVERGED: Final = 4
BAD_FIT: Final = 8
OVER_BUDGET: Final = 16
"""Bits of the quality of a contact; ``contacts.Quality`` explains them."""
