"""Makes the table and the figure of docs/hard-cases.md anew: ``python -m tests.hard``."""

import sys
from pathlib import Path

from skinbus.study.marked import Marks
from tests.hard.curves import draw_curves, measure_curves
from tests.hard.page import case_table

PAGE = Path("docs/hard-cases.md")

table, faults = case_table()
Marks("<!-- measured: begin -->", "<!-- measured: end -->").write(PAGE, table)
draw_curves(measure_curves(), PAGE.parent / "figures")
sys.exit("\n".join(faults))
