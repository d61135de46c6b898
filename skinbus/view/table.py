"""Contacts as a table for people."""

from __future__ import annotations

from collections.abc import Iterable

from rich.table import Table
from rich.text import Text

from skinbus.skin.contact import Contact

FORCE_BAR_N = 15.0
"""Force that fills the bar: a firm push of one finger."""

BAR_WIDTH = 15


def contact_table(contacts: Iterable[Contact]) -> Table:
    """Return a table of contacts."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("contact", "state", "link", "s mm", "a mm", "force N"):
        table.add_column(name, justify="left" if name in ("state", "link") else "right")
    table.add_column("", width=BAR_WIDTH)
    for row in contacts:
        bar = Text("█" * min(BAR_WIDTH, round(BAR_WIDTH * row.force / FORCE_BAR_N)), style="green")
        table.add_row(
            str(row.id),
            row.state.name.lower(),
            row.link,
            f"{row.s * 1e3:.1f}",
            f"{row.a * 1e3:.1f}",
            f"{row.force:.2f}",
            bar,
        )
    return table
