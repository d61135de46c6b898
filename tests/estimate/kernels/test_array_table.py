"""Kernels read and write a named tuple's arrays through its handle as if they had the tuple."""

import copy
import pickle
from typing import NamedTuple

import numpy as np
import pytest
from numba.core.errors import NumbaError

from skinbus.estimate.kernels.array_table import array_table
from skinbus.jit import kernel


class Some(NamedTuple):
    line: np.ndarray
    flags: np.ndarray
    table: np.ndarray
    block: np.ndarray


@kernel
def weighted_sum(some, out):
    total = 0.0
    for x in range(some.block.shape[0]):
        for y in range(some.block.shape[1]):
            for z in range(some.block.shape[2]):
                total += some.block[x, y, z] * some.table[y, z] * some.line[z]
                some.block[x, y, z] = 100 * x + 10 * y + z
    for i in range(len(some.flags)):
        total += some.flags[i]
    out[0] = total
    out[1] = some.table.size


def make():
    rng = np.random.default_rng(3)
    return Some(
        rng.integers(0, 9, 4), np.array([True, False, True]), rng.random((3, 4)), rng.random((2, 3, 4))
    )


def test_every_item_of_arrays_of_all_shapes_is_read_and_written():
    some, out = make(), np.zeros(2)
    want = np.einsum("xyz,yz,z->", some.block, some.table, some.line) + 2.0
    weighted_sum(array_table(some), out)
    assert out[0] == pytest.approx(want, rel=1e-14)
    assert out[1] == some.table.size
    assert np.array_equal(some.block, np.fromfunction(lambda x, y, z: 100 * x + 10 * y + z, (2, 3, 4)))


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_nothing_gets_a_second_hold_of_the_same_arrays(copied):
    with pytest.raises(TypeError, match="make another Estimator"):
        copied(array_table(make()))


def test_a_field_that_is_not_there_and_an_array_with_gaps_are_refused():
    @kernel
    def wrong(some):
        return some.width

    with pytest.raises(NumbaError, match="width"):
        wrong(array_table(make()))
    with pytest.raises(ValueError, match=r"Some\.table must be C-contiguous"):
        array_table(make()._replace(table=np.zeros((4, 3)).T))
