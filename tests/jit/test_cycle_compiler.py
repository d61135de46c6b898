"""What is compiled by the compiler of a cycle gives what Python gives, and faults are as numba's own."""

import os
import subprocess
import sys

import numpy as np
import pytest
from numba.core.errors import TypingError
from numpy.testing import assert_array_equal

from skinbus.jit import inner_kernel, kernel

BEYOND_THE_END = """
import numpy as np
from skinbus.jit import kernel

@kernel
def read(values, i):
    return values[i]

read(np.zeros(3), 3)
"""


@inner_kernel
def _pick(numbers, pairs, flags, i):
    numbers[3] = i + 0.5
    pairs[i, 0] = numbers[i] * 3 + numbers[3]  # truncated
    flags[0], flags[i] = numbers[i] > 1, pairs[i, 0] % 2 == 0
    row = pairs[i]
    row[1] += pairs[np.int16(3), np.uint8(1)] // 2
    return -(pairs[i, 0] ** 2) + row[1] / 4


def arrays():
    """Numbers, pairs of which no row is like another, and flags."""
    return np.arange(4) / 3, np.arange(8, dtype=np.int32).reshape(4, 2), np.zeros(4, np.bool_)


def test_items_of_arrays_by_indices_of_any_kind_and_operators_are_those_of_python():
    @kernel
    def pick(numbers, pairs, flags, i):
        return _pick(numbers, pairs, flags, i)

    for i in range(4):
        ours, theirs = arrays(), arrays()
        assert pick(*ours, i) == _pick.py_func(*theirs, i)
        for ours_is, theirs_is in zip(ours, theirs, strict=True):
            assert_array_equal(ours_is, theirs_is)


def test_what_has_no_type_is_refused_at_each_place():
    @kernel
    def add(values):
        return values[0] + "m"

    for _ in range(2):
        with pytest.raises(TypingError, match="No implementation of function"):
            add(np.zeros(2))


@pytest.mark.slow
def test_bounds_are_checked_where_numba_is_asked_to():
    done = subprocess.run(
        [sys.executable, "-c", BEYOND_THE_END],
        env=os.environ | {"NUMBA_BOUNDSCHECK": "1"}, capture_output=True, text=True,
    )  # fmt: skip
    assert "IndexError: index is out of bounds" in done.stderr
