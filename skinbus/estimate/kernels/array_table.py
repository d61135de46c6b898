"""Tuples of arrays in kernels, handed on by address: a kernel that calls another copies two words, not 900.

numba passes a tuple by value: each call copies address, size, shape and strides of all its arrays, and the
callers of a small kernel spend more time on that than on its numbers. Here Python writes those words to a
table once; a kernel gets the address of the table and reads ``work.p`` from it where it is used.

Uncompiled, a handle is the tuple itself.
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numba import config, typeof

from skinbus.jit.internals import ArrayTableType

T = TypeVar("T", bound=tuple[Any, ...])
kind_of: Any = typeof


def array_table(arrays: T) -> T:
    """Return what kernels take instead of a named tuple of arrays; it keeps them alive.

    Raises:
        ValueError: an array is not C-contiguous.
    """
    if getattr(config, "DISABLE_JIT", 0):
        return arrays
    made: Any = ArrayTable(arrays)
    return made  # type: ignore[no-any-return]


class ArrayTable:
    """The table of a named tuple of arrays: for each its address and its shape."""

    def __init__(self, arrays: Any) -> None:
        words: list[int] = []
        places = []
        for name, array in arrays._asdict().items():
            if not array.flags.c_contiguous:
                raise ValueError(f"{type(arrays).__name__}.{name} must be C-contiguous")
            places.append((name, kind_of(array), len(words)))
            words += [array.ctypes.data, *array.shape]
        self.arrays = arrays
        self.table = np.array(words, np.int64)
        self.address = int(self.table.ctypes.data)
        self._numba_type_ = ArrayTableType(type(arrays).__name__, tuple(places))

    def __reduce__(self) -> str:
        """Refuse to be copied: the copy would write to the arrays of the original."""
        raise TypeError("what kernels work on cannot be copied; make another Estimator")
