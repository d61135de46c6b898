"""The conformance table: every rule, on the patch and on the master, from bytes to bytes."""

import pytest

from tests.node.conformance_rows import ROWS
from tests.node.node_table import run

CASES = [(row, which) for row in ROWS for which in row.on]


@pytest.mark.parametrize(("row", "which"), CASES, ids=[f"{row.name}-{which}" for row, which in CASES])
def test_device_keeps_the_rule(row, which):
    run(row, which)
