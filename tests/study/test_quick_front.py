"""The quick front held against the stored one: less accurate, or slower beside the reference kernel, fails.

Where the change is meant, delete that file and: skinbus study run --quick --out tests/golden/quick-front.csv
"""

from pathlib import Path

from skinbus.cli.study import bits_on_wire
from skinbus.study.compare import regressions
from skinbus.study.sweep import executor_of, quick_grid, read_table, run_sweep

GOLDEN = Path(__file__).parents[1] / "golden" / "quick-front.csv"


def test_front_is_no_worse_than_the_stored_one(tmp_path):
    file = tmp_path / "quick.csv"
    with executor_of(workers=1) as executor:
        run_sweep(quick_grid(), file, bits_on_wire, executor)
    assert regressions(read_table(file), read_table(GOLDEN)) == []
