"""`skinbus replay`: the contacts of a recorded bus, made again by the very master that runs on a live one."""

from __future__ import annotations

import csv
import sys
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import click

from skinbus.can.event import Event
from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.options import channels_option, file_option, level_option, zero_option
from skinbus.cli.output import echo
from skinbus.cli.recorded import CONTACT_COLUMNS, Recorded, values_of
from skinbus.config.system import load_arm
from skinbus.estimate import TrackState
from skinbus.formatting import counted
from skinbus.skin.contact import Contact
from skinbus.view.event_log import EventLog

TITLES = ("contact", "link", "from s", "to s", "s mm", "a mm", "force N", "cycles")


@click.command()
@click.argument("log", type=click.Path(dir_okay=False, allow_dash=True))
@click.option("--arm", required=True, help="The arm that was recorded: a name or a TOML file.")
@channels_option
@level_option()
@zero_option
@file_option(
    "--out",
    callback=output.writable,
    help="Write every contact of every cycle to this CSV file; columns as in docs/export.md.",
)
def command(
    log: str,
    arm: str,
    channels: tuple[str, ...],
    level: str,
    zero: bool,
    out: Path | None,
) -> None:
    """Compute the contacts of LOG, a recording of `skinbus record` or candump; - is standard input.

    The frames go through the master of `skinbus run`, on the time of the recording and as fast as the machine
    can. The same log gives the same output. Times are seconds since the first frame.

    Status 0: there were readings. 1: there were none of this arm. 2: bad file or argument.

    \b
    Examples:
      skinbus replay field.log --arm my-arm.toml
      skinbus replay field.log --arm forearm --level full --out contacts.csv
      skinbus replay both.log --arm arm-two-buses -c upper=can0 -c lower=can1
    """
    loaded, console, lives, n_cycles = load_arm(arm, check_load=False), Console(), dict[int, Life](), 0
    events = EventLog(
        console.print,
        [bus.name for bus in loaded.buses],
        now=lambda: now_s,
        stamp=lambda t: f"{t:9.3f} s ",
    )
    now_s = 0.0

    def on_event(event: Event) -> None:
        nonlocal now_s
        now_s = 1e-9 * event.t_ns
        events.take(event)

    recorded = Recorded(
        "/dev/stdin" if log == "-" else log,
        loaded,
        channels,
        console,
        level=level,
        zero=zero,
        on_event=on_event,
    )
    with open(out, "w", encoding="utf-8", newline="") if out else nullcontext() as file:
        table = csv.DictWriter(file, CONTACT_COLUMNS, lineterminator="\n") if file else None
        if table:
            table.writeheader()
        for cycle, t_ns, _ in recorded:
            t_s = 1e-9 * cycle.t_ns
            now_s = max(now_s, t_s)
            events.show()
            n_cycles += 1
            for contact in cycle.contacts:
                if table:
                    table.writerow({"t_ns": t_ns, "cycle": cycle.number} | values_of(contact))
                if contact.state not in (TrackState.COAST, TrackState.LIFT):
                    life = lives.setdefault(contact.identity, Life(contact, t_s))
                    life.end_s, life.n_cycles = t_s, life.n_cycles + 1
                    life.firmest = max(life.firmest, contact, key=lambda one: one.force)
    events.show(all_of_it=True)
    rate_hz, said = recorded.arm.bus.rate_hz, ""
    if rate_hz != loaded.bus.rate_hz:
        said = f" (the arm file says {loaded.bus.rate_hz:g})"
    no_sync = ", without SYNC" if recorded.sync.bus is None else ""
    seconds = f"{1e-9 * recorded.replay.timeline.now_ns:.3f} s; {counted(n_cycles, 'cycle')}"
    echo(f"{log}: {seconds} at {rate_hz:.4g} Hz{no_sync}{said}, level {level}")
    if lives:
        console.table(TITLES, [life.row() for life in lives.values()])
    else:
        echo("no contacts")
    for line in recorded.summary():
        echo(line)
    if out:
        echo(f"contacts of every cycle: {out}")
    sys.exit(0 if recorded.has_readings() else 1)


@dataclass(slots=True)
class Life:
    """A contact from its first cycle to its last."""

    firmest: Contact
    start_s: float
    end_s: float = 0.0
    n_cycles: int = 0

    def row(self) -> tuple[object, ...]:
        """Return it as a row of TITLES: its place is where it was firmest."""
        one, span = self.firmest, (f"{self.start_s:.3f}", f"{self.end_s:.3f}")
        place = f"{1e3 * one.s:.1f}", f"{1e3 * one.a:.1f}"
        return one.id, one.link, *span, *place, f"{one.force:.2f}", self.n_cycles
