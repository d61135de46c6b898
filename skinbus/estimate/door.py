"""What is asked of arguments that come in from outside, the same at every door of the estimator."""

from __future__ import annotations

import operator
from typing import Any

TIME_LEAST, TIME_MOST = -(2**61), 3 * 2**61 - 1
"""ns, 73 years before and 219 after 0: the difference of two times fits into 64 bits."""


def check_time(t_ns: Any) -> int:
    """Return a time in ns as an int.

    Raises:
        TypeError: it is no integer; it would come to light far from here, on the bus.
        ValueError: differences of such times would not be numbers of 64 bits.
    """
    time: int = operator.index(t_ns)
    if not TIME_LEAST <= time <= TIME_MOST:
        raise ValueError(f"t_ns must be from {TIME_LEAST} to {TIME_MOST}, got {time}")
    return time
