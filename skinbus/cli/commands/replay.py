"""`skinbus replay`: the contacts of a recorded bus, made again by the very master that runs on a live one."""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from functools import partial
from io import TextIOWrapper
from pathlib import Path
from typing import Any, Final, TextIO

import click

from skinbus.can.core import NEVER
from skinbus.can.event import Event
from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.event_log import EventLog
from skinbus.cli.formatting import counted, nodes, words_of
from skinbus.cli.host import NOT_FOR_PEOPLE, compiling
from skinbus.cli.options import Range, file_option, json_option, level_option, log_channels_option
from skinbus.cli.output import JsonFile, echo
from skinbus.cli.recording_report import frames_of, has_readings, in_words
from skinbus.config.system import load_arm
from skinbus.estimate import LEVELS, TrackState
from skinbus.master import CycleReport
from skinbus.master.replay import Replay
from skinbus.skin.compile_ahead import parts_of
from skinbus.skin.master_cycles import CycleMaker
from skinbus.skin.replayed import Recording

SHOWN_EVERY: Final = 20_000
"""Frames, some seconds of a full bus, after which the progress is shown."""
COLUMNS: Final = (
    "time", "t_s", "sync", "id", "link", "state", "s_mm", "a_mm", "force_n", "level", "quality",
)  # fmt: skip
"""Of the CSV file: ``time`` of the SYNC as the recording has it, ``t_s`` since its first frame."""
UNSEEN: Final = (TrackState.COAST, TrackState.LIFT)


@click.command()
@click.argument("log", type=output.Readable(allow_dash=True))
@click.option("--arm", required=True, help="The arm that was recorded: a name or a TOML file.")
@log_channels_option
@level_option()
@click.option("--zero", is_flag=True, help="Take the first readings of each patch as its zero.")
@click.option("--from", "start_s", type=Range(min=0.0), default=0.0, help="Show cycles from this time on, s.")
@click.option("--to", "end_s", type=Range(min=0.0, min_open=True), help="End at this time, s.")
@file_option("--out", callback=output.writable, help="Write every contact of every cycle to this CSV file.")
@json_option
def command(
    log: str,
    arm: str,
    channels: tuple[str, ...],
    level: str,
    zero: bool,
    start_s: float,
    end_s: float | None,
    out: Path | None,
    json_file: JsonFile | None,
) -> None:
    """Compute the contacts of LOG, a recording of `skinbus record` or candump; - is standard input.

    The frames go through the master of `skinbus run`, on the time of the recording and as fast as the machine
    can. The same log gives the same output. Times are seconds since the first frame. Frames before --from are
    processed too: zeros and identities come from them.

    Status 0: there were readings. 1: there were none of this arm. 2: bad file or argument.

    \b
    Examples:
      skinbus replay field.log --arm my-arm.toml
      skinbus replay field.log --arm forearm --level full --from 12 --to 15 --out contacts.csv
      skinbus replay both.log --arm arm-two-buses -c upper=can0 -c lower=can1
      skinbus replay field.log.gz --arm forearm --json -
    """
    end_s = math.inf if end_s is None else end_s
    if end_s <= start_s:
        raise click.UsageError(f"--to {end_s:g} is not after --from {start_s:g}")
    loaded = load_arm(arm, check_load=False)
    recording = Recording(_standard_input() if log == "-" else log, loaded, channels)
    console = Console()
    with compiling(console, parts_of(level)):
        account = Account(recording, level, zero, (start_s, end_s), console)
    played, replay = recording.arm, account.replay
    # What belongs to the last cycle may come until the one after has begun.
    until_ns = NEVER if math.isinf(end_s) else round(end_s * 1e9) + 2 * replay.master.period_ns
    status = console.status(f"{log} ...") if console.is_terminal else nullcontext()
    with open(out, "w", encoding="utf-8", newline="") if out else nullcontext() as file, status as shown:
        if file:
            account.rows = csv.writer(file, lineterminator="\n")
            account.rows.writerow(COLUMNS)
        for n, frame in enumerate(recording):
            replay.take(frame)
            if replay.timeline.now_ns > until_ns:
                break
            if shown and n % SHOWN_EVERY == 0:
                shown.update(f"{log} ... {replay.timeline.now_ns * 1e-9:.0f} s")
        replay.end()
    account.events.show(all_of_it=True)
    seconds, silent = min(replay.timeline.now_ns * 1e-9, end_s), list(silent_nodes(replay))
    rate = f"{played.bus.rate_hz:.4g} Hz" + ("" if recording.sync.bus is not None else ", without SYNC")
    said = "" if played is loaded else f" (the arm file says {loaded.bus.rate_hz:g})"
    echo(f"{log}: {seconds:.3f} s; {counted(account.n_cycles, 'cycle')} at {rate}{said}, level {level}")
    for line in (*account.table(), *in_words(replay, recording)):
        echo(line)
    for line in silent:
        echo(f"no readings of {line}")
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
                "contacts": [asdict(life) for life in account.lives.values()],
                "frames": frames_of(replay, recording),
                "silent": silent,
            }
        )
    sys.exit(0 if has_readings(replay, recording) else 1)


@dataclass(slots=True)
class Life:
    """A contact from its first cycle to its last; its place is where it was firmest."""

    id: int
    link: str
    from_s: float
    to_s: float = 0.0
    s_mm: float = 0.0
    a_mm: float = 0.0
    force_n: float = 0.0
    """At its most."""
    cycles: int = 0


class Account:
    """Keeps the contacts of all cycles in a span of time (s), and shows events."""

    def __init__(
        self, recording: Recording, level: str, zero: bool, span_s: tuple[float, float], console: Console
    ) -> None:
        arm = recording.arm
        self.replay = Replay(
            arm, sync_bus=recording.sync.bus, on_cycle=self.take, on_event=self._on_event, level=level,
            zero_at_start=zero,
        )  # fmt: skip
        self.lives: dict[int, Life] = {}
        """Contacts by identity, in the order in which they came."""
        self.n_cycles = 0
        self.events = EventLog(
            partial(console.print, soft_wrap=True),
            [bus.name for bus in arm.buses],
            now=lambda: self._now_s,
            stamp=lambda t: f"{t:9.3f} s ",
        )
        self.rows: Any = None
        """A csv.writer for the contacts of every cycle, or None."""
        self._maker, self._links = CycleMaker(arm), [link.name for link in arm.links]
        self._span_s, self._now_s = span_s, 0.0

    def take(self, report: CycleReport) -> None:
        """Take a cycle."""
        t_s = report.t_ns * 1e-9
        self._now_s = (report.t_ns + report.latency_ns) * 1e-9
        records = self._maker.make(self.replay.master, report).records
        if not self._span_s[0] <= t_s <= self._span_s[1]:
            return
        self.n_cycles += 1
        t_us = self.replay.sync_stamp_ns // 1000
        for contact in records[records["id"] > 0]:
            link, state = self._links[contact["link"]], TrackState(contact["state"])
            s_mm, a_mm, force = 1e3 * contact["s"], 1e3 * contact["a"], float(contact["force"])
            if state not in UNSEEN:
                identity = int(contact["identity"])
                life = self.lives.setdefault(identity, Life(int(contact["id"]), link, round(t_s, 3)))
                life.to_s, life.cycles = round(t_s, 3), life.cycles + 1
                if force > life.force_n:
                    life.link, life.force_n = link, round(force, 3)
                    life.s_mm, life.a_mm = round(float(s_mm), 3), round(float(a_mm), 3)
            if self.rows:
                known = contact["level"] < len(LEVELS)
                doubts = (LEVELS[contact["level"]], words_of(int(contact["quality"]))) if known else ("", "")
                words = (
                    f"{t_us // 1_000_000}.{t_us % 1_000_000:06d}", f"{t_s:.6f}", str(report.counter),
                    str(contact["id"]), link, state.name.lower(), f"{s_mm:.2f}", f"{a_mm:.2f}",
                    f"{force:.3f}", *doubts,
                )  # fmt: skip
                self.rows.writerow(words)
        self.events.show()

    def _on_event(self, event: Event) -> None:
        self._now_s = event.t_ns * 1e-9
        if event.kind not in NOT_FOR_PEOPLE and self._span_s[0] <= self._now_s <= self._span_s[1]:
            self.events.take(event)

    def table(self) -> Iterator[str]:
        """Return a line for each contact, below a line of heads."""
        if not self.lives:
            yield "no contacts"
            return
        width = max(4, *map(len, self._links))
        yield f"contact  {'link':<{width}}    from s      to s    s mm    a mm  force N  cycles"
        for life in self.lives.values():
            yield (
                f"{life.id:>7}  {life.link:<{width}} {life.from_s:>9.3f} {life.to_s:>9.3f} {life.s_mm:>7.1f} "
                f"{life.a_mm:>7.1f} {life.force_n:>8.2f} {life.cycles:>7}"
            )


def silent_nodes(replay: Replay) -> Iterator[str]:
    """Return by bus the patches that never sent all of their readings."""
    arm, last_fresh = replay.master.arm, replay.master.table.last_fresh
    for bus, settings in enumerate(arm.buses):
        patches = arm.patches_on(bus)
        if node_ids := arm.node_id[patches][last_fresh[patches] == 0].tolist():
            yield f"{settings.name} {nodes(node_ids)}" if len(arm.buses) > 1 else nodes(node_ids)


def _standard_input() -> TextIO:
    """Return standard input, in which any byte is a character."""
    if isinstance(sys.stdin, TextIOWrapper):
        sys.stdin.reconfigure(encoding="ascii", errors="replace")
    return sys.stdin
