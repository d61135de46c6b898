"""`skinbus replay`: the contacts of a recorded bus, made again by the very master that runs on a live one."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from contextlib import closing, nullcontext
from dataclasses import asdict
from functools import partial
from io import TextIOWrapper
from pathlib import Path
from typing import Final, TextIO

import click

from skinbus.can.core import NEVER
from skinbus.can.event import Event
from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.event_log import EventLog
from skinbus.cli.formatting import counted
from skinbus.cli.host import NOT_FOR_PEOPLE, compiling
from skinbus.cli.options import Range, file_option, json_option, level_option, log_channels_option
from skinbus.cli.output import JsonFile, echo
from skinbus.cli.replay_report import (
    Account,
    Life,
    compared,
    comparison_of,
    frames_of,
    in_words,
    silent_nodes,
    table,
)
from skinbus.config.system import load_arm
from skinbus.master import CycleReport
from skinbus.master.level_control import CycleFlags
from skinbus.master.replay import Replay, Sync
from skinbus.model import Arm
from skinbus.objects.profile import MASTER_NODE_ID
from skinbus.skin.compile_ahead import parts_of
from skinbus.skin.recording import Recording
from skinbus.view.compare import Comparison, Differences

SHOWN_EVERY: Final = 20_000
"""Frames, some seconds of a full bus, after which the progress is shown."""

HURRIED: Final = CycleFlags.CUT_SHORT | CycleFlags.LOWERED
"""What a master says of a cycle that it had less time for than a recording has."""


@click.command()
@click.argument("log", type=output.Readable(allow_dash=True))
@click.option("--arm", required=True, help="The arm whose patches were recorded: a name or a TOML file.")
@log_channels_option
@level_option()
@click.option(
    "--zero", is_flag=True, help="Take what each patch reads first for its zero, as run --zero does."
)
@click.option("--from", "start_s", type=Range(min=0.0), help="Show cycles from this time of the log on, s.")
@click.option("--to", "end_s", type=Range(min=0.0, min_open=True), help="End at this time of the log, s.")
@file_option("--out", callback=output.writable, help="Write every contact of every cycle to this CSV file.")
@click.option(
    "--compare",
    "compares",
    is_flag=True,
    help="Hold the contacts that a master published in the log against those made now; exit with 1 when any "
    "differ.",
)
@click.option(
    "--node-id",
    default=MASTER_NODE_ID,
    show_default=True,
    type=click.IntRange(1, 127),
    help="Node-ID of the master in the log.",
)
@json_option
def command(
    log: str,
    arm: str,
    channels: tuple[str, ...],
    level: str,
    zero: bool,
    start_s: float | None,
    end_s: float | None,
    out: Path | None,
    compares: bool,
    node_id: int,
    json_file: JsonFile | None,
) -> None:
    """Make contacts from LOG, a recording of `skinbus record` or candump; - is standard input.

    Frame by frame the recording goes through the same master as on a live bus, on its own time and as fast as
    the machine can. It may begin anywhere, and its master may have been another. Lines that are no frame are
    counted. The same log gives the same output. Times are seconds since its first frame; what comes before
    --from is gone through too, for zeros and identities come from it.

    Status 0: there were readings. 1: there were none of this arm, or --compare found a difference. 2: bad
    file or argument.

    \b
    Examples:
      skinbus replay field.log --arm my-arm.toml
      skinbus replay field.log --arm forearm --level full --from 12 --to 15 --out contacts.csv
      skinbus replay candump-2026-11-21_121731.log --arm forearm --compare
      skinbus replay both.log --arm arm-two-buses -c upper=can0 -c lower=can1
      skinbus replay field.log.gz --arm forearm --json -
    """
    if start_s is not None and end_s is not None and end_s <= start_s:
        raise click.UsageError(f"--to {end_s:g} is not after --from {start_s:g}")
    for path in (out, json_file and json_file.path):
        if path and log != "-" and Path(path).exists() and Path(path).samefile(log):
            raise click.UsageError(f"{path} is the log itself; it would be lost")
    loaded = load_arm(arm, check_load=False)
    if node_id in loaded.node_id:
        raise click.UsageError(f"--node-id {node_id} is that of a patch of {loaded.name}")
    recording = Recording(_standard_input() if log == "-" else log, loaded, channels)
    reader, sync, played = recording.reader, recording.sync, recording.arm
    console = Console()
    say = partial(console.print, soft_wrap=True)
    account = Account(played, start_s, end_s, out)
    events = EventLog(
        say, [bus.name for bus in played.buses], now=account.now_s, stamp=lambda t: f"{t:9.3f} s "
    )

    def on_cycle(report: CycleReport) -> None:
        account.take(report)
        events.show()

    def on_event(event: Event) -> None:
        account.happened_ns = event.t_ns
        if event.kind not in NOT_FOR_PEOPLE and account.counts(event.t_ns):
            events.take(event)

    comparison = (
        Comparison(played, node_id, bus=sync.bus or 0, counts=account.counts, reasons=HURRIED)
        if compares
        else None
    )
    with compiling(console, parts_of(level)):
        replay = account.replay = Replay(
            played,
            sync_bus=sync.bus,
            on_cycle=on_cycle,
            on_frames=(lambda frames: comparison.take_made(account.t_ns, frames)) if comparison else None,
            on_event=on_event,
            level=level,
            node_id=node_id,
            zero_at_start=zero,
        )
    # What belongs to the last cycle may come until the one after has begun.
    until_ns = NEVER if end_s is None else round(end_s * 1e9) + 2 * replay.master.period_ns
    with closing(account), console.status(f"{log} ...") if console.is_terminal else nullcontext() as status:
        for n, frame in enumerate(recording):
            replay.take(frame)
            if comparison:
                comparison.take_recorded(frame._replace(t_ns=replay.timeline.now_ns))
            if replay.timeline.now_ns > until_ns:
                break
            if status and n % SHOWN_EVERY == 0:
                status.update(f"{log} ... {replay.timeline.now_ns * 1e-9:.0f} s")
        replay.end()
    events.show(all_of_it=True)
    counted = frames_of(replay, reader, recording.elsewhere)
    found = comparison.end() if comparison else None
    seconds = min(replay.timeline.now_ns * 1e-9, end_s or math.inf)
    cycles = cycles_in_words(loaded, played, sync, account.n_cycles)
    silent = list(silent_nodes(replay))
    echo(f"{log}: {seconds:.3f} s; {cycles}, level {level}")
    for line in table(account.lives) if account.lives else ["no contacts"]:
        echo(line)
    for line in in_words(counted, reader):
        echo(line)
    for line in silent:
        echo(f"no readings of {line}")
    for line in compared(found) if found else ():
        echo(line)
    if out:
        echo(f"contacts of every cycle: {out}")
    if json_file:
        json_file.write(
            {
                "log": log,
                "arm": loaded.name,
                "seconds": round(seconds, 6),
                "level": level,
                "rate_hz": played.bus.rate_hz,
                "cycles": account.n_cycles,
                "contacts": [rounded(life) for life in account.lives],
                "frames": counted,
                "silent": silent,
                "compared": comparison_of(found) if found else None,
            }
        )
    sys.exit(status_of(loaded, replay, recording.elsewhere, found, node_id))


def cycles_in_words(arm: Arm, played: Arm, sync: Sync, n: int) -> str:
    """Return how many cycles there were and how often, and where that comes from."""
    text = f"{counted(n, 'cycle')} at {played.bus.rate_hz:.4g} Hz"
    if sync.bus is None:
        text += ", without SYNC"
    return text if played is arm else f"{text} (the arm file says {arm.bus.rate_hz:g})"


def rounded(life: Life) -> dict[str, object]:
    """Return a contact for a program."""
    return {
        key: round(value, 3) if isinstance(value, float) else value for key, value in asdict(life).items()
    }


def status_of(
    arm: Arm, replay: Replay, elsewhere: Mapping[str, int], found: Differences | None, node_id: int
) -> int:
    """Return the exit status, and say why it is not 0."""
    if not replay.master.table.last_fresh.any():
        others = f" It also holds {', '.join(sorted(elsewhere))}: see --channel." if elsewhere else ""
        echo(f"no patch of {arm.name} sent readings: is it the log of another arm?{others}", err=True)
        return 1
    if found is None:
        return 0
    if not found.n_same + found.n_different:
        echo(f"nothing to compare: no master with node-ID {node_id} published contacts", err=True)
        return 1
    return 1 if found.n_different else 0


def _standard_input() -> TextIO:
    """Return standard input, in which any byte is a character."""
    if isinstance(sys.stdin, TextIOWrapper):
        sys.stdin.reconfigure(encoding="ascii", errors="replace")
    return sys.stdin
