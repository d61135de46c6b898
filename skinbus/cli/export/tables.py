"""Readings and contacts of a recording as MCAP or Parquet: the parts of the log, one after another."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import click
import numpy as np

from skinbus import __version__
from skinbus.cli.console import Console
from skinbus.cli.export.new_file import new_file, say_left_out, shown_progress
from skinbus.cli.export.rows import Recomputed, RecordingRows, recompute
from skinbus.cli.formatting import counted
from skinbus.cli.host import compiling
from skinbus.cli.output import echo
from skinbus.errors import SkinbusError
from skinbus.model import Arm

RAW: Final = "(counts - offset) * scale * gain of the tactel, before its zero"
ZEROED: Final = "as the recomputing master used it, less the zero; none where it used no reading"


def contacts_beside(out: Path) -> Path:
    """Return where the contacts go beside a Parquet file of readings."""
    return out.with_name(f"{out.stem}.contacts{out.suffix}")


def export_tables(
    log: Path,
    arm: Arm,
    out: Path,
    channels: tuple[str, ...],
    *,
    node_id: int,
    level: str | None,
    zero: bool,
) -> None:
    """Write readings and contacts; end with status 1, and no file, where the log has no readings of the arm.

    Args:
        log: the recording.
        arm: whose patches were recorded.
        out: the file to write; its ending is the format.
        channels: interfaces in the log, by bus or as NAME=CHANNEL.
        node_id: of the master whose contacts are taken from the log.
        level: of the master that recomputes them, None for none.
        zero: whether that master takes what each patch reads first for its zero.
    """
    is_mcap = out.suffix.lower() == ".mcap"
    with ExitStack() as stack:
        part_file = stack.enter_context(new_file(out, log))
        beside = None if is_mcap else stack.enter_context(new_file(contacts_beside(out), log))
        show = stack.enter_context(shown_progress(log))
        remade = _recomputed(log, arm, channels, level, zero, show) if level else None
        rows = RecordingRows(log, arm, channels, node_id)
        about = {
            "arm": arm.name,
            "log": log.name,
            "skinbus": __version__,
            "pressure": ZEROED if remade and is_mcap else RAW,
            **({"level": level} if level else {}),
        }
        file = _file(part_file, beside, rows.arm, about)
        steps = np.array([placed.patch.transducer.step for placed in arm.patches])
        scale = steps[arm.tactel_patch] * arm.tactel_gain
        for part in rows:
            tactel = part.readings["tactel"]
            raw = (part.readings["counts"] - arm.tactel_offset[tactel]) * scale[tactel]
            zeroed, recomputed = remade.of(part) if remade else (None, None)
            file.add(part, raw, zeroed, recomputed)
            show(counted(rows.n_readings, "reading"))
        file.close()
        if not rows.n_readings:  # and what was there before stays
            others = (
                f" It holds {', '.join(sorted(rows.elsewhere))}: see --channel." if rows.elsewhere else ""
            )
            echo(f"no patch of {arm.name} sent readings: is it the log of another arm?{others}", err=True)
            raise click.exceptions.Exit(1)
    _report(rows, len(remade.contacts) if remade else None, out, level)


def _file(part: Path, beside: Path | None, arm: Arm, about: dict[str, str]) -> Any:
    """Return what writes the parts of a recording."""
    try:
        if beside is None:
            from skinbus.cli.export.mcap import McapFile

            return McapFile(part, arm, about)
        from skinbus.cli.export.parquet import ParquetFiles

        return ParquetFiles(part, beside, arm, about)
    except ImportError as error:
        raise SkinbusError(f"this format needs {error.name}; pip install 'skinbus[export]'") from error


def _recomputed(
    log: Path,
    arm: Arm,
    channels: tuple[str, ...],
    level: str,
    zero: bool,
    show: Callable[[str], None],
) -> Recomputed:
    from skinbus.skin.compile_ahead import parts_of

    def on_time(s: float) -> None:
        show(f"recomputed to {s:.0f} s")

    with compiling(Console(stderr=True), parts_of(level)):
        return recompute(log, arm, channels, level=level, zero=zero, on_time=on_time)


def _report(rows: RecordingRows, n_recomputed: int | None, out: Path, level: str | None) -> None:
    readings = f"{counted(rows.n_readings, 'reading')} of tactels in {counted(rows.n_cycles, 'cycle')}"
    contacts = f"{counted(rows.n_contacts, 'contact')} published"
    if n_recomputed is not None:
        contacts += f", {n_recomputed} recomputed (level {level})"
    elif not rows.n_contacts:
        contacts = "no contacts published by a master in the log: --recompute makes them"
    echo(f"{out}: {readings}; {contacts}")
    if out.suffix.lower() != ".mcap":
        echo(f"{contacts_beside(out)}: the contacts")
    if rows.n_wrong:
        echo(f"left out: {counted(rows.n_wrong, 'frame')} of wrong length")
    for name, n in sorted(rows.elsewhere.items()):
        echo(f"left out: {counted(n, 'frame')} of {name}")
    say_left_out(rows.reader)
