"""Files that an export writes: whole or not at all, and over nothing but an older export."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import click

from skinbus.can.candump import CandumpReader
from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.formatting import counted
from skinbus.cli.output import echo

HEADS: Final = {
    ".mcap": (b"\x89MCAP",),
    ".parquet": (b"PAR1",),
    ".dbc": (b"VERSION",),
}
"""What files of ours begin with, by their ending: no other is written over."""


@contextmanager
def new_file(path: Path, *inputs: Path) -> Iterator[Path]:
    """Yield where to write a file, which takes its place when it is whole; ``inputs`` stay."""
    if path.exists() and any(path.samefile(given) for given in inputs):
        raise click.UsageError(f"{path} is an input; it would be lost")
    if os.fspath(path).startswith(output.STREAMS):
        raise click.UsageError(f"{path}: wanted a file")
    output.try_to_write(path)
    heads = HEADS[path.suffix.lower()]
    output.keep_inputs(path, f"{path.suffix[1:]} file of skinbus", lambda content: content.startswith(heads))
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def shown_progress(log: Path) -> Iterator[Callable[[str], None]]:
    """Show on a terminal how far the work is; yields what takes it as text."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda text: None
        return
    with console.status(f"{log} ...") as status:
        yield lambda text: status.update(f"{log} ... {text}")


def say_left_out(reader: CandumpReader) -> None:
    """Say which lines of a recording were no frames, and what the recorder lost."""
    if reader.first_strange:
        n, where = reader.n_strange, reader.first_strange.key
        echo(f"left out: {counted(n, 'line')} that {'is' if n == 1 else 'are'} no frame, first at {where}")
    if reader.is_cut:
        echo("left out: the last line, which is not whole")
    if reader.n_dropped:
        echo(f"the recorder had no room for {counted(reader.n_dropped, 'frame')}")
