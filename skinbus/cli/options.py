"""Options that several commands share."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import click

DEFAULT_BITRATE = 1_000_000


def bus_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --interface, --channel and --bitrate: the three words with which python-can opens a bus."""
    options = [
        click.option(
            "--interface",
            default="socketcan",
            show_default=True,
            help="python-can interface: socketcan, virtual, udp_multicast, slcan, pcan, ...",
        ),
        click.option("--channel", default=None, help="Channel of the interface; can0 on socketcan."),
        click.option(
            "--bitrate",
            default=None,
            type=click.IntRange(10_000, 1_000_000),
            help="Bit/s, where the interface lets it be set (default: what the arm file says).",
        ),
    ]
    for option in reversed(options):
        command = option(command)
    return command


LEVELS = ("kmeans", "fit", "full")
"""Names of the estimator's levels, known here without its imports; a test holds both lists equal."""

level_option = click.option(
    "--level", default="kmeans", show_default=True, type=click.Choice(LEVELS), help="Level of the estimator."
)
seconds_option = click.option(
    "--seconds", type=click.FloatRange(min=0.0, min_open=True), help="Stop by itself after this time."
)


def _writable(ctx: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    """Refuse a file that could not be written at the end, before the work begins."""
    folder = os.path.dirname(os.path.abspath(value)) if value else ""
    if folder and not (os.path.isdir(folder) and os.access(folder, os.W_OK)):
        raise click.BadParameter(f"cannot write to the folder {folder}")
    return value


json_option = click.option(
    "--json",
    "json_file",
    type=click.Path(dir_okay=False, writable=True),
    callback=_writable,
    help="Write a summary to this file.",
)
