"""What commands that draw share: the option of a folder, and one message where matplotlib is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from skinbus.cli import output
from skinbus.errors import SkinbusError


def folder_option(name: str, *, default: str | None = None, help: str | None = None) -> Any:
    """Return the option of a folder for files that a study makes."""
    return click.option(
        name,
        "folder",
        default=default,
        show_default=default is not None,
        type=click.Path(file_okay=False, path_type=Path),
        callback=output.folder,
        help=help,
    )


@contextmanager
def figures_wanted() -> Iterator[None]:
    """Turn a missing matplotlib into one clear message."""
    try:
        yield
    except ImportError as error:
        raise SkinbusError(f"figures need matplotlib ({error}); pip install 'skinbus[figures]'") from error
