"""`skinbus profile`: what firmware must do, and the objects of boards and of the master, as Markdown."""

from __future__ import annotations

from pathlib import Path

import click

from skinbus.cli import output
from skinbus.cli.options import file_option
from skinbus.cli.output import echo
from skinbus.cli.profile_page import objects_of, page


@click.command()
@click.argument("eds", required=False)
@file_option("--out", callback=output.writable, help="Write to this file.")
def command(eds: str | None, out: Path | None) -> None:
    """Print the profile of patches and master, or the objects of one EDS.

    \b
    Examples:
      skinbus profile --out profile.md
      skinbus profile my-board.eds
    """
    text = "\n\n".join(objects_of(eds)) + "\n" if eds else page()
    if out is None:
        echo(text, nl=False)
    else:
        out.write_text(text)
