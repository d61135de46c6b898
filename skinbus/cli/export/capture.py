"""A recording as a capture for Wireshark."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import click
import numpy as np

from skinbus.can.candump_batches import CandumpBatches
from skinbus.can.pcap import PcapngWriter, PcapWriter
from skinbus.cli.export.new_file import new_file, say_left_out, shown_progress
from skinbus.cli.formatting import counted
from skinbus.cli.output import echo


def capture(log: Path, out: Path, channels: tuple[str, ...]) -> None:
    """Write all frames of a log, or those of ``channels``; several interfaces go to one pcapng."""
    wanted = {channel.partition("=")[2] or channel for channel in channels}
    is_named = out.suffix.lower() == ".pcapng"
    with new_file(out, log) as part, shown_progress(log) as show:
        reader, n_written = _write(log, part, wanted, show, named=is_named)
        names = [name for name in reader.channels if not wanted or name in wanted]
        if missing := sorted(wanted - set(names)):
            there = ", ".join(reader.channels)
            raise click.UsageError(f"{log} has no frames of {', '.join(missing)}: it has those of {there}")
        if len(names) > 1 and not is_named:  # pcap has no room for their names
            reader, n_written = _write(log, part, wanted, show, named=True)
    form = ", as pcapng: pcap holds one interface" if len(names) > 1 and not is_named else ""
    echo(f"{out}: {counted(n_written, 'frame')} of {', '.join(names)}{form}")
    say_left_out(reader)


def _write(
    log: Path, out: Path, wanted: set[str], show: Callable[[str], None], *, named: bool
) -> tuple[CandumpBatches, int]:
    """Write frames; return their reader and how many they were."""
    reader, n_written = CandumpBatches(log), 0
    with out.open("wb") as file:
        write = _writer(file, reader, named=named)
        for batch in reader.batches():
            frames, t_ns = batch.frames[: batch.n], batch.t_ns[: batch.n]
            if wanted:
                numbers = [k for k, name in enumerate(reader.channels) if name in wanted]
                here = np.isin(frames["bus"], numbers)
                frames, t_ns = frames[here], t_ns[here]
            write(frames, t_ns)
            n_written += len(frames)
            show(counted(n_written, "frame"))
    return reader, n_written


def _writer(file: BinaryIO, reader: CandumpBatches, *, named: bool) -> Callable[..., None]:
    if not named:
        return PcapWriter(file).write
    writer = PcapngWriter(file)
    return lambda frames, t_ns: writer.write(frames, t_ns, reader.channels)
