"""Assignment: rows and columns paired one to one at the least total cost.

Shortest augmenting paths with dual prices: every row in turn is brought in along the cheapest chain of
exchanges, found as Dijkstra finds it. Optimal for any finite costs; at most n_rows^2 n_columns steps.

Source: R. Jonker, A. Volgenant, Computing 38 (1987) 325; the rectangular form is that of D. F. Crouse,
IEEE Trans. Aerosp. Electron. Syst. 52 (2016) 1679.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.jit import inner_kernel

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]


class AssignWork(NamedTuple):
    """Buffers for up to n rows and n columns."""

    row_price: Floats  # (n,)
    column_price: Floats
    shortest: Floats  # (n,) length of the cheapest path to a column
    path: Ints  # (n,) row from which that path comes
    row_done: Bools
    column_done: Bools
    column_of: Ints  # (n,) the result by row
    row_of: Ints  # (n,) the result by column, -1 for none


def make_assign_work(n: int) -> AssignWork:
    """Return buffers for problems of up to n x n."""

    def floats() -> Floats:
        return np.zeros(n)

    def ints() -> Ints:
        return np.zeros(n, np.int64)

    def flags() -> Bools:
        return np.zeros(n, np.bool_)

    return AssignWork(floats(), floats(), floats(), ints(), flags(), flags(), ints(), ints())


@inner_kernel
def assign(cost: Floats, n_rows: int, n_columns: int, w: Any) -> None:
    """Write the column of each row to ``w.column_of``, n_rows <= n_columns; -1 where no cost is finite.

    w has the columns of :class:`AssignWork`.
    """
    u, v = w.row_price, w.column_price
    for i in range(n_rows):
        u[i] = 0.0
        w.column_of[i] = -1
    for j in range(n_columns):
        v[j] = 0.0
        w.row_of[j] = -1
    for start in range(n_rows):
        for j in range(n_columns):
            w.shortest[j] = np.inf
            w.column_done[j] = False
        for i in range(n_rows):
            w.row_done[i] = False
        # Grow the tree of cheapest paths until it meets a column that is free.
        i, reach, sink = start, 0.0, -1
        while sink < 0:
            w.row_done[i] = True
            best, lowest = -1, np.inf
            for j in range(n_columns):
                if w.column_done[j]:
                    continue
                r = reach + cost[i, j] - u[i] - v[j]
                if r < w.shortest[j]:
                    w.shortest[j] = r
                    w.path[j] = i
                # of equally near columns a free one ends the search
                if w.shortest[j] < lowest or (w.shortest[j] == lowest and w.row_of[j] < 0):
                    lowest = w.shortest[j]
                    best = j
            if best < 0:  # costs that are not finite: no path; the row keeps none
                break
            reach = lowest
            w.column_done[best] = True
            if w.row_of[best] < 0:
                sink = best
            else:
                i = w.row_of[best]
        if sink < 0:
            continue
        u[start] += reach
        for i in range(n_rows):
            if w.row_done[i] and i != start:
                u[i] += reach - w.shortest[w.column_of[i]]
        for j in range(n_columns):
            if w.column_done[j]:
                v[j] -= reach - w.shortest[j]
        # Exchange along the path.
        j = sink
        while True:
            i = w.path[j]
            w.row_of[j] = i
            j, w.column_of[i] = w.column_of[i], j
            if i == start:
                break
