"""Readings and contacts of a recording as MCAP or Parquet: the parts of the log, one after another."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
import numpy as np
import numpy.typing as npt

from skinbus import __version__
from skinbus.cli.console import Console
from skinbus.cli.export.new_file import new_file, say_left_out, shown_progress
from skinbus.cli.export.rows import LOGGED, RecordingRows
from skinbus.cli.formatting import counted
from skinbus.cli.host import compiling
from skinbus.cli.output import echo
from skinbus.errors import SkinbusError
from skinbus.model import Arm

if TYPE_CHECKING:
    from skinbus.cli.export.mcap_file import McapFile
    from skinbus.cli.export.parquet import ParquetFiles
    from skinbus.cli.export.recompute import Recomputed

PUBLISHED: Final = "published"
RECOMPUTED: Final = "recomputed"

RAW: Final = "(counts - offset) * scale * gain of the tactel, before its zero"
ZEROED: Final = "as the recomputing master used it, less the zero; none where it used no reading"


@contextmanager
def extra_wanted() -> Iterator[None]:
    """Turn a missing package into one clear message."""
    try:
        yield
    except ImportError as error:
        raise SkinbusError(f"this format needs {error.name}; pip install 'skinbus[export]'") from error


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

    node_id: of the master whose contacts are taken from the log
    level:   of the master that recomputes them, None for none
    zero:    whether that master takes what each patch reads first for its zero
    """
    is_mcap = out.suffix.lower() == ".mcap"
    with ExitStack() as stack:
        with extra_wanted():
            if is_mcap:
                from skinbus.cli.export.mcap_file import McapFile
            else:
                from skinbus.cli.export.parquet import ParquetFiles
        part = stack.enter_context(new_file(out, log))
        beside = None if is_mcap else stack.enter_context(new_file(contacts_beside(out), log))
        show = stack.enter_context(shown_progress(log))
        remade = _recomputed(log, arm, channels, level, zero, show) if level else None
        rows = RecordingRows(log, arm, channels, node_id)
        about = {
            "arm": arm.name,
            "log": log.name,
            "skinbus": __version__,
            "pressure": ZEROED if remade and is_mcap else RAW,
            **({"level": remade.level} if remade else {}),
        }
        if beside is None:
            with part.open("wb") as file:
                mcap = McapFile(file, rows.arm, about)
                _to_mcap(rows, remade, mcap, show)
                mcap.close()
        else:
            parquet = ParquetFiles(part, beside, rows.arm, about)
            _to_parquet(rows, remade, parquet, show)
            parquet.close()
        if not rows.n_readings:  # and what was there before stays
            others = (
                f" It holds {', '.join(sorted(rows.elsewhere))}: see --channel." if rows.elsewhere else ""
            )
            echo(f"no patch of {arm.name} sent readings: is it the log of another arm?{others}", err=True)
            raise click.exceptions.Exit(1)
    _report(rows, remade, out)


def _recomputed(
    log: Path, arm: Arm, channels: tuple[str, ...], level: str, zero: bool, show: Callable[[str], None]
) -> Recomputed:
    from skinbus.cli.export.recompute import recompute
    from skinbus.skin.compile_ahead import parts_of

    with compiling(Console(stderr=True), parts_of(level)):
        return recompute(
            log,
            arm,
            channels,
            level=level,
            zero=zero,
            on_time=lambda s: show(f"recomputed to {s:.0f} s"),
        )


def _pressures(arm: Arm) -> Callable[[npt.NDArray[Any]], npt.NDArray[np.float64]]:
    """Return what makes pressures of readings (of ROW), Pa, before the zeros."""
    steps = np.array([placed.patch.transducer.step for placed in arm.patches])
    scale = steps[arm.tactel_patch] * arm.tactel_gain

    def pressures(rows: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        tactel = rows["tactel"]
        return np.asarray((rows["counts"] - arm.tactel_offset[tactel]) * scale[tactel])

    return pressures


def _to_parquet(
    rows: RecordingRows, remade: Recomputed | None, file: ParquetFiles, show: Callable[[str], None]
) -> None:
    pressures = _pressures(rows.arm)
    for part in rows:
        zeroed = remade.pressures_of(part.readings, part.begun) if remade else None
        file.add_readings(part.readings, pressures(part.readings), zeroed)
        file.add_contacts(PUBLISHED, part.contacts)
        show(counted(rows.n_readings, "reading"))
    if remade:
        file.add_contacts(RECOMPUTED, remade.contacts)


def _to_mcap(
    rows: RecordingRows, remade: Recomputed | None, file: McapFile, show: Callable[[str], None]
) -> None:
    pressures = _pressures(rows.arm)
    groups, contacts = np.zeros(0, LOGGED), np.zeros(0, LOGGED)
    for part in rows:
        pascals: Any = pressures(part.readings)
        if remade:
            pascals = remade.pressures_of(part.readings, part.begun)
        file.add_readings(part.readings, pascals, part.begun)
        groups, contacts = np.append(groups, part.groups), np.append(contacts, part.contacts)
        file.add_contacts(PUBLISHED, groups[:-1], contacts)  # the last may go on in the next part
        groups, contacts = groups[-1:], contacts[contacts["group"] >= groups["group"].max(initial=0)]
        show(counted(rows.n_readings, "reading"))
    file.add_contacts(PUBLISHED, groups, contacts)
    if remade:
        file.add_contacts(RECOMPUTED, remade.groups, remade.contacts)


def _report(rows: RecordingRows, remade: Recomputed | None, out: Path) -> None:
    readings = f"{counted(rows.n_readings, 'reading')} of tactels in {counted(rows.n_cycles, 'cycle')}"
    contacts = f"{counted(rows.n_contacts, 'contact')} published"
    if remade:
        contacts += f", {len(remade.contacts)} recomputed (level {remade.level})"
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
