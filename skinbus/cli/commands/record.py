"""`skinbus record`: what is on a bus, as a file that candump's friends and `skinbus replay` read."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import click

from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.bus.recorder import Recorder
from skinbus.can.candump import CandumpWriter
from skinbus.cli import output
from skinbus.cli.host import Host
from skinbus.cli.options import DEFAULT_BITRATE, Where, bus_options, seconds_option
from skinbus.cli.output import echo
from skinbus.config.system import load_arm
from skinbus.formatting import counted
from skinbus.model import BusSettings
from skinbus.skin.addresses import shown, to_listen


def new_file(ctx: click.Context, parameter: click.Parameter, value: str | None) -> str:
    """Return where the recording goes, by default a name of the time; refuse a file that is there already."""
    if value == "-":
        return value
    path = value or time.strftime("skinbus-%Y-%m-%d_%H%M%S.log")
    if Path(path).exists():
        raise click.BadParameter(f"{path} is there already; give the recording another name")
    output.try_to_write(path)
    return path


@click.command()
@click.argument("log", required=False, type=click.Path(dir_okay=False, allow_dash=True), callback=new_file)
@click.option("--arm", help="Record the buses of this arm, a name or a TOML file.")
@bus_options
@seconds_option
def command(
    log: str,
    arm: str | None,
    where: Where,
    seconds: float | None,
) -> None:
    """Record all that is on a bus to LOG, as candump writes it, until Ctrl-C; - is standard output.

    Without LOG the file is named by date and time. A file named *.gz is compressed. If a bus is lost, the
    command waits for it. Each line is written at once: a killed recording lacks its last line at most.
    `skinbus replay` computes contacts from it.

    Status 0: frames were recorded. 1: there were none. 2: a bad file or argument. 3: no bus.

    \b
    Examples:
      skinbus record
      skinbus record field.log --channel can0 --seconds 60
      skinbus record both.log --arm arm-two-buses -c upper=can0 -c lower=can1
      skinbus record field.log.gz -c can0 -c can1
    """
    places = where.places(*buses_for(arm, where.channels))
    names = [place.channel or place.interface for place in places]
    clock, say = MonotonicClock(), partial(echo, err=log == "-")
    with ExitStack() as stack:
        writer = CandumpWriter(sys.stdout if log == "-" else log, channels=names, clock=clock)
        stack.callback(writer.close)
        recorder = Recorder(writer, len(places))
        try:
            host = Host(recorder, [*map(to_listen, places)], say=say, steady=True)
            say(f"recording {shown(places)} to {log}; Ctrl-C stops")
            with host:
                host.wait(seconds)
        except OSError as error:
            if error.errno:  # of the file, not of the bus
                error.filename = error.filename or log
            raise
        finally:
            if not writer.n_frames and log != "-":
                Path(log).unlink()
    say(summary_line(log, writer, recorder, host.report.n_outages))
    if not writer.n_frames:
        echo(f"nothing was received: is any node active on {shown(places)}?", err=True)
        sys.exit(1)


def buses_for(arm: str | None, channels: Sequence[str]) -> Sequence[BusSettings]:
    """Return the buses of an arm, or without one a bus for each channel."""
    if arm is not None:
        return load_arm(arm, check_load=False).buses
    if any("=" in word for word in channels):
        raise click.UsageError("names of buses are those of an arm file: give --arm")
    if len(set(channels)) < len(channels):
        raise click.UsageError("a channel is given twice")
    return [BusSettings(bitrate=DEFAULT_BITRATE)] * max(len(channels), 1)


def summary_line(log: str, writer: CandumpWriter, recorder: Recorder, n_outages: int) -> str:
    """Return what was recorded."""
    parts = [f"{counted(writer.n_frames, 'frame')} in {(writer.last_ns - writer.first_ns) * 1e-9:.1f} s"]
    if recorder.n_dropped:
        parts.append(f"{counted(recorder.n_dropped, 'frame')} lost, the machine had no room for them")
    if n_outages:
        parts.append(f"the bus was lost {counted(n_outages, 'time')}")
    return f"{log}: {'; '.join(parts)}"
