"""The conformance table: every rule, on the patch and on the master, from bytes to bytes."""

import pytest
import rows_emcy
import rows_lss
import rows_nmt
import rows_pdo
import rows_pdo_rules
import rows_sdo
import rows_sdo_block
import rows_storage
import rows_trigger
from node_table import Row, run

TABLES = (
    rows_nmt,
    rows_sdo,
    rows_sdo_block,
    rows_pdo,
    rows_pdo_rules,
    rows_emcy,
    rows_storage,
    rows_lss,
    rows_trigger,
)
ROWS: list[Row] = [row for table in TABLES for row in table.ROWS]
CASES = [(row, which) for row in ROWS for which in row.on]


@pytest.mark.parametrize(("row", "which"), CASES, ids=[f"{row.name}-{which}" for row, which in CASES])
def test_device_keeps_the_rule(row, which):
    run(row, which)


def test_every_rule_has_its_own_name_and_section():
    assert len({row.name for row in ROWS}) == len(ROWS)
    assert all(row.section.split()[0] in {"301", "305", "401"} for row in ROWS)


def test_table_is_large_enough():
    assert len(ROWS) >= 120
