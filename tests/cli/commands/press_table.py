"""Presses as a CSV file."""

import csv


def write_presses(path, presses, arm, swap=False):
    """Write presses as the table that commands read; ``swap``: s and a in each other's column."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        n = max(len(press.readings) for press in presses)
        rows.writerow(["node_id", "s_mm", "a_mm", "force_n", *(f"p{k + 1}" for k in range(n))])
        for press in presses:
            where = [1e3 * press.s, 1e3 * press.a]
            rows.writerow([arm.node_id[press.patch], *where[:: -1 if swap else 1], 5.0, *press.readings])
    return path
