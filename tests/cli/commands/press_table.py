"""Presses as a CSV file."""

import csv


def write_presses(path, presses, arm):
    """Write presses as the table that commands read."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        n = max(len(press.readings) for press in presses)
        rows.writerow(["node_id", "s_mm", "a_mm", "force_n", *(f"p{k + 1}" for k in range(n))])
        for press in presses:
            rows.writerow([arm.node_id[press.patch], 1e3 * press.s, 1e3 * press.a, 5.0, *press.readings])
    return path
