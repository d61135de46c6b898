"""A front held against a stored one: is the estimator less accurate, or slower, than it was."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

WORSE: Final = 1.15
"""A median may be worse by this factor: a few of forty cycles that fall on the other side of it."""
SLACK: Final = {
    "position_median_mm": 0.02,
    "force_median_pct": 0.3,
    "missed_pct": 2.5,
    "wrong_count_pct": 5.0,
}
"""And by this much, in the unit of the column: one or two cycles of forty."""
SLOWER: Final = 1.5
"""The ratio to the reference kernel may grow by this factor."""


def regressions(rows: Mapping[str, Mapping[str, Any]], stored: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return what is worse than stored, a line for each; empty when nothing is.

    Accuracy is compared cell by cell; time method by method, by the median over its cells, because a busy
    machine disturbs single ones.
    """
    faults = []
    for key, old in stored.items():
        new = rows.get(key)
        if new is None:
            faults.append(f"{key}: not measured")
            continue
        for column, slack in SLACK.items():
            limit = WORSE * old[column] + slack
            if not new[column] <= limit:
                faults.append(f"{key}: {column} is {new[column]:.3g}; wanted at most {limit:.3g}")
    for method in sorted({str(row["method"]) for row in stored.values()}):
        before, now = _time(stored, method), _time(rows, method)
        if not now <= SLOWER * before:
            faults.append(f"{method}: takes {now:.2f} of the reference; wanted at most {SLOWER * before:.2f}")
    return faults


def _time(rows: Mapping[str, Mapping[str, Any]], method: str) -> float:
    ratios = [row["time_ratio"] for row in rows.values() if row["method"] == method]
    return float(np.median(ratios)) if ratios else float("nan")
