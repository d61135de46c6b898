"""`skinbus replay`: the contacts of a recorded bus, made again by the very master that runs on a live one."""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import asdict
from functools import partial
from io import TextIOWrapper
from itertools import chain, islice, pairwise
from pathlib import Path
from typing import Final, TextIO

import click
from rich.console import Console

from skinbus.can.candump import CandumpReader
from skinbus.can.core import NEVER
from skinbus.can.event import Event
from skinbus.can.frame import Frame
from skinbus.cli import output
from skinbus.cli.bus_address import channels_by_name
from skinbus.cli.event_log import EventLog
from skinbus.cli.formatting import counted
from skinbus.cli.host import NOT_FOR_PEOPLE, compiling
from skinbus.cli.options import Range, json_option, level_option
from skinbus.cli.output import JsonFile
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
from skinbus.config.system import load_arm, ods_of
from skinbus.errors import ConfigError, Fault
from skinbus.master import CycleReport
from skinbus.master.level_control import CycleFlags
from skinbus.master.replay import Replay, Sync, find_sync
from skinbus.model import Arm
from skinbus.objects.profile import MASTER_NODE_ID
from skinbus.objects.readings import ReadingsPlan
from skinbus.view.compare import Comparison, Differences

HEAD: Final = 20_000
"""Frames, some seconds of a full bus, from which interfaces and rate are found before the work begins."""

MOST_BACK: Final = 0.1
"""Share of frames that may have an earlier time than the one before on their interface."""

SAME_RATE: Final = 0.05
"""A recording whose rate is this near to that of the arm file has that rate."""

HURRIED: Final = CycleFlags.CUT_SHORT | CycleFlags.LOWERED
"""What a master says of a cycle that it had less time for than a recording has."""


@click.command()
@click.argument("log", type=click.Path(exists=True, dir_okay=False, allow_dash=True))
@click.option("--arm", required=True, help="The arm whose patches were recorded: a name or a TOML file.")
@click.option(
    "-c",
    "--channel",
    "channels",
    multiple=True,
    help="Interface in the log: one for each bus in the order of the arm file, or NAME=CHANNEL. By default "
    "what the arm file says, or the only one in the log.",
)
@level_option("fit")
@click.option(
    "--zero", is_flag=True, help="Take what each patch reads first for its zero, as run --zero does."
)
@click.option("--from", "start_s", type=Range(min=0.0), help="Show cycles from this time of the log on, s.")
@click.option("--to", "end_s", type=Range(min=0.0, min_open=True), help="End at this time of the log, s.")
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    callback=output.writable,
    help="Write every contact of every cycle to this CSV file.",
)
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

    Status 0: there were readings. 1: there were none of this arm, or --compare found a difference. 2: a wrong
    file or word.

    \b
    Examples:
      skinbus replay field.log --arm my-arm.toml
      skinbus replay field.log --arm forearm --level full --from 12 --to 15 --out contacts.csv
      skinbus replay candump-2026-11-21_121731.log --arm forearm --compare
      skinbus replay both.log --arm arm-two-buses -c upper=can0 -c lower=can1
      zcat field.log.gz | skinbus replay - --arm forearm --json -
    """
    if start_s is not None and end_s is not None and end_s <= start_s:
        raise click.UsageError(f"--to {end_s:g} is not after --from {start_s:g}")
    for path in (out, json_file and json_file.path):
        if path and log != "-" and Path(path).exists() and Path(path).samefile(log):
            raise click.UsageError(f"{path} is the log itself; it would be lost")
    loaded = load_arm(arm, check_load=False)
    if node_id in loaded.node_id:
        raise click.UsageError(f"--node-id {node_id} is that of a patch of {loaded.name}")
    reader = CandumpReader(_standard_input() if log == "-" else log)
    lines = iter(reader)
    head = list(islice(lines, HEAD))
    check_times(reader.name, head)
    buses = buses_of(loaded, channels, Counter(name for _, name in head), log)
    sync = find_sync(
        (frame._replace(bus=buses[name]) for frame, name in head if name in buses),
        ReadingsPlan(loaded, ods_of(loaded)).cob_ids_on,
    )
    played = at_rate(loaded, sync.rate_hz)
    console = Console()
    say = partial(console.print, markup=False, highlight=False, soft_wrap=True)
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
    with compiling(console) as on_compile:
        replay = account.replay = Replay(
            played,
            sync_bus=sync.bus,
            on_cycle=on_cycle,
            on_frames=(lambda frames: comparison.take_made(account.t_ns, frames)) if comparison else None,
            on_event=on_event,
            level=level,
            node_id=node_id,
            zero_at_start=zero,
            on_compile=on_compile,
        )
    # What belongs to the last cycle may come until the one after has begun.
    until_ns = NEVER if end_s is None else round(end_s * 1e9) + 2 * replay.master.period_ns
    elsewhere: Counter[str] = Counter()
    with closing(account), console.status(f"{log} ...") if console.is_terminal else nullcontext() as status:
        for n, (frame, name) in enumerate(chain(head, lines)):
            bus = buses.get(name)
            if bus is None:
                elsewhere[name] += 1
                continue
            if bus:
                frame = frame._replace(bus=bus)
            replay.take(frame)
            if comparison:
                comparison.take_recorded(frame._replace(t_ns=replay.timeline.now_ns))
            if replay.timeline.now_ns > until_ns:
                break
            if status and n % HEAD == 0:
                status.update(f"{log} ... {replay.timeline.now_ns * 1e-9:.0f} s")
        replay.end()
    events.show(all_of_it=True)
    counted = frames_of(replay, reader, elsewhere)
    found = comparison.end() if comparison else None
    seconds = min(replay.timeline.now_ns * 1e-9, end_s or math.inf)
    cycles = cycles_in_words(loaded, played, sync, account.n_cycles)
    silent = list(silent_nodes(replay))
    click.echo(f"{log}: {seconds:.3f} s; {cycles}, level {level}")
    for line in table(account.lives) if account.lives else ["no contacts"]:
        click.echo(line)
    for line in in_words(counted, reader):
        click.echo(line)
    for line in silent:
        click.echo(f"no readings of {line}")
    for line in compared(found) if found else ():
        click.echo(line)
    if out:
        click.echo(f"contacts of every cycle: {out}")
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
    sys.exit(status_of(loaded, replay, elsewhere, found, node_id))


def check_times(name: str, head: Sequence[tuple[Frame, str]]) -> None:
    """Raise ConfigError when the times of a log are none: candump -td shows pauses in their place."""
    # Several interfaces are read in turns: only what came on one of them is in order.
    times_ns = [
        [frame.t_ns for frame, channel in head if channel == one] for one in {channel for _, channel in head}
    ]
    n_back = sum(later < earlier for times in times_ns for earlier, later in pairwise(times))
    if n_back > MOST_BACK * len(head):
        seen = f"{n_back} of {len(head)} go back"
        raise ConfigError(name, [Fault("times", seen, "times of frames, as of candump -l, -ta or -tz")])


def buses_of(arm: Arm, channels: Sequence[str], seen: Mapping[str, int], log: str) -> dict[str, int]:
    """Return the bus of the arm that each interface in the log is; ``seen`` are those there by name.

    Raises:
        click.UsageError: that cannot be decided, or two buses are on one interface.
    """
    said = channels_by_name(arm.buses, channels)
    there = ", ".join(f"{name} ({counted(n, 'frame')})" for name, n in sorted(seen.items()))
    names: list[str] = []
    faults: list[str] = []
    for settings, name in zip(arm.buses, said, strict=True):
        if name is None and settings.channel in seen:
            name = settings.channel
        if name is None and len(arm.buses) == len(seen) == 1:
            (name,) = seen
        if name is None and len(arm.buses) == 1:
            faults.append("say by --channel which of them is meant")
        elif name is None:
            faults.append(f"say by --channel {settings.name}=... which of them bus {settings.name} is")
        elif name in names:
            faults.append(f"bus {settings.name} is on {name}, as another bus is")
        else:
            names.append(name)
    if faults:
        raise click.UsageError(f"{log} begins with {there}: {'; '.join(faults)}")
    return {name: k for k, name in enumerate(names)}


def at_rate(arm: Arm, rate_hz: float | None) -> Arm:
    """Return the arm at the rate of the recording, where that is another than its file says."""
    if rate_hz is None or abs(rate_hz / arm.bus.rate_hz - 1.0) <= SAME_RATE:
        return arm
    return arm.with_rate(rate_hz)


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
        click.echo(f"no patch of {arm.name} sent readings: is it the log of another arm?{others}", err=True)
        return 1
    if found is None:
        return 0
    if not found.n_same + found.n_different:
        click.echo(f"nothing to compare: no master with node-ID {node_id} published contacts", err=True)
        return 1
    return 1 if found.n_different else 0


def _standard_input() -> TextIO:
    """Return standard input, in which any byte is a character."""
    if isinstance(sys.stdin, TextIOWrapper):
        sys.stdin.reconfigure(encoding="ascii", errors="replace")
    return sys.stdin
