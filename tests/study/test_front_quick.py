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
"""Times are medians of so many: what disturbs one of them is no change of the code."""


@pytest.mark.slow
def test_front_is_no_worse_than_the_stored_one(tmp_path):
    tables = []
    for n in range(MEASUREMENTS):
        file = tmp_path / f"quick-{n}.csv"
        with executor_of(workers=1) as executor:
            run_sweep(quick_grid(), file, executor)
        tables.append(read_table(file))
    rows = {key: dict(row) for key, row in tables[0].items()}
    for key, row in rows.items():
        row["time_ratio"] = median(table[key]["time_ratio"] for table in tables)
    assert regressions(rows, read_table(GOLDEN)) == []
