"""Columns are made from their declaration, whatever shape numpy gives to the hints in it."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.estimate.columns import filled


class Declared(NamedTuple):
    """Two columns; a list stands for NDArray as numpy 2.5 makes it, with the type of its numbers alone."""

    old: npt.NDArray[np.int64]
    new: list[np.bool_]


def test_columns_have_the_types_that_are_declared():
    columns = filled(Declared, 3, {"new": 2})
    assert (columns.old.dtype, columns.old.shape) == (np.int64, (3,))
    assert (columns.new.dtype, columns.new.shape) == (np.bool_, (2,))
