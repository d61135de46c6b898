"""Checks of arguments that come with an arm: the arm itself, times, and which patches are fresh."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Bools
from skinbus.model.arm import Arm

TIME_LEAST, TIME_MOST = -(2**61), 3 * 2**61 - 1
"""ns, 73 years before and 219 after 0: the difference of two times fits into 64 bits."""


def check_time(t_ns: Any) -> int:
    """Return a time in ns as an int.

    Raises:
        TypeError: it is no integer; it would come to light far from here, on the bus.
        ValueError: differences of such times would not be numbers of 64 bits.
    """
    time = check_integer("t_ns", t_ns)
    if not TIME_LEAST <= time <= TIME_MOST:
        raise ValueError(f"t_ns must be from {TIME_LEAST} to {TIME_MOST}, got {time}")
    return time


def check_arm(arm: Any) -> None:
    """Refuse what is no arm, and one with tactels that are not on it, as files cannot have them.

    Raises:
        TypeError: it is something else, such as the name of one.
        ValueError: a board is beyond the end of a cylinder or cone. A sheet goes on flat beyond its ends.
    """
    if not isinstance(arm, Arm):
        raise TypeError(f"arm must be an Arm, as skinbus.load_arm returns it; got {arm!r}")
    for number, link in enumerate(arm.links):
        s = arm.tactel_s[arm.tactel_link == number]
        if (
            len(s)
            and link.surface.kind != "plane"
            and not (s.min() >= 0.0 and s.max() <= link.surface.length)
        ):
            ends = f"{s.min():.4g} to {s.max():.4g} m"
            raise ValueError(f"{link.name} has tactels at s = {ends}; it ends at {link.surface.length:.4g} m")


def check_fresh(arm: Arm, fresh: npt.ArrayLike | None) -> Bools:
    """Return of which patches readings are there, (n_patches,); None for all.

    Raises:
        ValueError: it has the wrong shape.
    """
    shape = (arm.n_patches,)
    flags = np.ones(shape, np.bool_) if fresh is None else np.asarray(fresh, np.bool_)
    if flags.shape != shape:
        raise ValueError(f"fresh must have shape {shape}, got {flags.shape}")
    return flags


def check_integer(name: str, value: Any) -> int:
    """Return an argument as an int.

    Raises:
        TypeError: it is no integer.
    """
    try:
        return operator.index(value)
    except TypeError:
        raise TypeError(f"{name} must be an integer, got {value!r}") from None
