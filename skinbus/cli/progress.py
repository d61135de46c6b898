"""A bar with the time left, for commands that take minutes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import Progress

from skinbus.cli.console import Console


@contextmanager
def progress(console: Console, text: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show a bar with the time left; a number of cells moves it on."""
    with Progress(console=console) as bar:
        task = bar.add_task(text, total=total)
        yield lambda n: bar.update(task, advance=n)
