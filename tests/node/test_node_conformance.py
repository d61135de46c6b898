"""The conformance table: every rule, on patches, alone, hosted and as firmware, and on the master."""

import pytest

from tests.node.node_table import load_rows, run

CASES = [(row, which) for row in load_rows() for which in row.on.split(",")]


@pytest.mark.parametrize(("row", "which"), CASES, ids=[f"{row.name}-{which}" for row, which in CASES])
def test_device_keeps_the_rule(row, which):
    run(row, which)
