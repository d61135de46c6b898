"""The console of commands: a string is text without markup, its control characters are escaped."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Console as RichConsole
from rich.console import ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table

from skinbus.cli.output import forget_output
from skinbus.printable import layout

WIDE = 1000
"""Characters of a line in a pipe or file: nothing there has an edge at which a table would have to be cut."""


class Console(RichConsole):
    """A console on which a string is text only: styles are arguments, never part of it."""

    def __init__(self, *, stderr: bool = False, outlives_reader: bool = False, **settings: Any) -> None:
        """``outlives_reader``: go on without output when nobody reads it any more."""
        super().__init__(
            stderr=stderr, markup=False, emoji=False, highlight=False, soft_wrap=True, **settings
        )
        self._outlives_reader = outlives_reader
        if not self.is_terminal and "width" not in settings and "COLUMNS" not in os.environ:
            self.width = WIDE

    def on_broken_pipe(self) -> None:
        """End with status 1, or write to nowhere from now on."""
        if not self._outlives_reader:
            super().on_broken_pipe()
        forget_output()

    def table(self, titles: Sequence[str], rows: Iterable[Sequence[Any]], title: str | None = None) -> None:
        """Print a table; columns of cells that begin with a digit or sign are right-aligned."""
        cells = [[*map(str, row)] for row in rows]
        table = Table(*titles, title=title, title_justify="left", box=None, pad_edge=False)
        for k, column in enumerate(table.columns):
            is_number = all(row[k].lstrip("+-")[:1].isdigit() for row in cells)
            column.justify = "right" if is_number else "left"
        for row in cells:
            table.add_row(*row)
        self.print(table, soft_wrap=False)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Return what is shown; whatever made it, control characters come from the console only."""
        for segment in super().render(renderable, options):
            if segment.control or segment.text.isprintable():
                yield segment
            else:
                yield segment._replace(text=layout(segment.text))
