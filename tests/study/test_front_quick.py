"""The quick front held against the stored one: less accurate, or slower beside the reference kernel, fails.

Where the change is meant, delete that file and: skinbus study run --quick --out tests/golden/quick-front.csv
"""

from pathlib import Path
from statistics import median

import pytest

from skinbus.study.compare import regressions
from skinbus.study.sweep import executor_of, quick_grid, read_table, run_sweep

GOLDEN = Path(__file__).parents[1] / "golden" / "quick-front.csv"


MEASUREMENTS = 3
"""Times are medians of at least so many: what disturbs one of them is no change of the code."""
MOST = 9
"""Measurements while the median is too slow: a busy machine shifts some of them, slower code all."""


@pytest.mark.slow
def test_front_is_no_worse_than_the_stored_one(tmp_path):
    tables, faults = [], []
    while len(tables) < MEASUREMENTS or (faults and len(tables) < MOST):
        file = tmp_path / f"quick-{len(tables)}.csv"
        with executor_of(workers=1) as executor:
            run_sweep(quick_grid(), file, executor)
        tables.append(read_table(file))
        rows = {key: dict(row) for key, row in tables[0].items()}
        for key, row in rows.items():
            row["time_ratio"] = median(table[key]["time_ratio"] for table in tables)
        faults = regressions(rows, read_table(GOLDEN))
        if any("takes" not in fault for fault in faults):  # accuracy is the same each time
            break
    assert faults == []
