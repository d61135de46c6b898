"""Assignment of contacts to tracks, against that of SciPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from skinbus.estimate.kernels.array_table import array_table
from skinbus.estimate.tracking import assignment
from skinbus.estimate.tracking.assignment import make_assign_work
from tests.inner_kernels import from_python

assign = from_python(assignment.assign)

SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS, st.integers(1, 12), st.integers(0, 12), st.booleans())
def test_assignment_is_as_cheap_as_that_of_scipy(seed, n_rows, more, has_ties):
    rng = np.random.default_rng(seed)
    n_columns = n_rows + more
    cost = np.zeros((24, 24))
    values = rng.integers(-3, 4, (n_rows, n_columns)) if has_ties else rng.normal(size=(n_rows, n_columns))
    cost[:n_rows, :n_columns] = values
    work = make_assign_work(24)
    assign(cost, n_rows, n_columns, array_table(work))
    columns = work.column_of[:n_rows]
    assert len(set(columns.tolist())) == n_rows
    want = values[linear_sum_assignment(values)].sum()
    assert values[np.arange(n_rows), columns].sum() == pytest.approx(want, abs=1e-12)
