"""The quick front held against the stored one: less accurate, or slower beside the reference kernel, fails.

Where the change is meant, delete that file and: skinbus study run --quick --out tests/golden/quick-front.csv
"""

from pathlib import Path

from skinbus.study.compare import regressions
from skinbus.study.sweep import executor_of, quick_grid, read_table, run_sweep

GOLDEN = Path(__file__).parents[1] / "golden" / "quick-front.csv"


MEASUREMENTS = 3
"""What disturbs one of them is no change of the code; a change of the code slows down all."""


def test_front_is_no_worse_than_the_stored_one(tmp_path):
    for n in range(MEASUREMENTS):
        file = tmp_path / f"quick-{n}.csv"
        with executor_of(workers=1) as executor:
            run_sweep(quick_grid(), file, executor)
        faults = regressions(read_table(file), read_table(GOLDEN))
        if not any("of the reference" in fault for fault in faults):
            break
    assert faults == []
