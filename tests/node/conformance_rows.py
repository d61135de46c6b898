"""All rows of the conformance table."""

from tests.node import (
    rows_emcy,
    rows_guarding,
    rows_lss,
    rows_nmt,
    rows_pdo,
    rows_pdo_rules,
    rows_sdo,
    rows_sdo_block,
    rows_storage,
    rows_sync_window,
    rows_trigger,
)
from tests.node.node_table import Row

TABLES = (
    rows_nmt,
    rows_sdo,
    rows_sdo_block,
    rows_pdo,
    rows_pdo_rules,
    rows_emcy,
    rows_guarding,
    rows_storage,
    rows_sync_window,
    rows_lss,
    rows_trigger,
)


ROWS: list[Row] = [row for table in TABLES for row in table.ROWS]
