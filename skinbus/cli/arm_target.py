"""The arm file that a command changes: which one, and whether it may."""

from __future__ import annotations

from pathlib import Path

import click

from skinbus.cli import output
from skinbus.config.arm_file import read_arm_file
from skinbus.model import Arm


def arm_target(arm: str, path: Path, loaded: Arm, out: Path | None) -> Path:
    """Return the file to write.

    Args:
        arm: as the user named it.
        path: its file.
        loaded: what the file describes.
        out: the file to write in place of it.
    """
    if any(placed.on_chart is not None for placed in loaded.patches):
        raise click.UsageError(f"{arm} has boards on meshes: their places and node-IDs are written by hand")
    if out is None and str(path) != arm:
        raise click.UsageError(f"{arm} ships with skinbus and is not written; say where to by --out")
    target = out or path
    output.try_to_write(target, ".toml")
    output.keep_files([target], arm, read_arm_file(path).files[1:])  # the first is the arm file
    return target
