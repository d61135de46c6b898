"""`skinbus monitor`: the contacts that a master publishes, live; a listener like any other CANopen tool."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, nullcontext
from typing import Any

import click
from rich.console import Group
from rich.live import Live
from rich.text import Text

from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.can.clock import Clock
from skinbus.can.frame import Frame
from skinbus.cli.console import Console
from skinbus.cli.options import BusWords, arm_bus_options, seconds_option
from skinbus.cli.output import echo
from skinbus.cli.stop_signals import Ending
from skinbus.config.system import load_arm
from skinbus.master.level_control import CycleFlags
from skinbus.objects.profile import MASTER_NODE_ID
from skinbus.skin.listener import ContactRow, Listener
from skinbus.view.table import contact_table

POLL_S = 0.1
"""Frames are looked at ten times a second: what eyes can follow."""
SILENT_NS = 1_000_000_000
"""A master that was not heard for so long has gone."""
DOUBTS = {
    CycleFlags.INCOMPLETE: "not all patches have readings proven to be of this SYNC: 0x2300 shows which",
    CycleFlags.IMPAIRED: "tactels are not plausible and count as missing: 0x2305 shows which",
}
"""What is said of a cycle by its flags; the numbers are objects of the master."""


@click.command()
@click.argument("arm", required=False)
@arm_bus_options
@click.option("--json-lines", "is_stream", is_flag=True, help="Print a line of JSON for every cycle instead.")
@seconds_option
def command(
    arm: str | None,
    bus: BusWords,
    is_stream: bool,
    seconds: float | None,
) -> None:
    """Show the contacts that a master publishes, until Ctrl-C; status 1 when no master sent anything.

    With ARM (a name or a TOML file) links have names; the bus carries only their numbers. All buses of an arm
    carry the same contacts: name one of them. Without a terminal the screen is printed once, at the end.

    \b
    Examples:
      skinbus monitor --channel can0
      skinbus monitor forearm --channel can0
      skinbus monitor arm-two-buses --bus upper -c can0
      skinbus monitor forearm --json-lines | jq -c .contacts
    """
    loaded = load_arm(arm, check_load=False) if arm else None
    links = tuple(link.name for link in loaded.links) if loaded else ()
    clock, listener = MonotonicClock(), Listener(MASTER_NODE_ID)
    console = Console()
    is_live = console.is_terminal and not is_stream
    with (
        Ending() as ending,
        closing((bus.of(loaded)[1] if loaded else bus.place()).open()) as opened,
        Live(console=console, refresh_per_second=10) if is_live else nullcontext() as live,
    ):
        end = time.monotonic() + seconds if seconds else float("inf")
        while time.monotonic() < end and not ending.asked:
            frames = [frame for frame in opened.receive(POLL_S) if not frame.flags]
            for line in cycles(listener, clock, frames, links):
                if is_stream:
                    echo(json.dumps(line))
            if live:
                live.update(_screen(listener, clock.now_ns(), links))
    if not is_stream and not live:
        console.print(_screen(listener, clock.now_ns(), links))
    if not listener.n_summaries:
        echo("nothing of a master was received: does one run on this bus?", err=True)
        raise SystemExit(1)


def cycles(
    listener: Listener, clock: Clock, frames: Sequence[Frame], links: Sequence[str]
) -> Iterator[dict[str, Any]]:
    """Take frames; return a row for programs of each cycle that they end."""
    for frame in frames:
        for said, rows in listener.take(clock.now_ns(), frame):
            yield {
                "sync": said.counter,
                "patches_alive": said.alive,
                "compute_us": said.compute_us,
                "latency_us": said.latency_us,
                "level": said.level,
                "flags": [flag.name.lower() for flag in said.flags if flag.name],
                "contacts": rows_of(rows, links),
            }


def rows_of(rows: Sequence[ContactRow], links: Sequence[str]) -> list[dict[str, Any]]:
    """Return contacts for a program, rounded to the resolution of their TPDO."""
    return [
        {
            "id": row.id,
            "link": links[row.link] if row.link < len(links) else row.link,
            "state": row.state.name.lower(),
            "s_mm": round(1e3 * row.s, 1),
            "a_mm": round(1e3 * row.a, 1),
            "force_n": round(row.force, 2),
        }
        for row in rows
    ]


def _screen(listener: Listener, now_ns: int, links: tuple[str, ...]) -> Group:
    """Return what is shown: the summary line and the table of contacts."""
    s = listener.summary
    if s is None or now_ns - listener.last_heard_ns > SILENT_NS:
        head = Text("waiting for a master ...", style="yellow")
    else:
        head = Text(
            f"SYNC {s.counter:3d}   patches {s.alive}   contacts {s.n_contacts}   "
            f"compute {s.compute_us} us   latency {s.latency_us / 1e3:.1f} ms   level {s.level or 'unknown'}"
        )
        for flag, text in DOUBTS.items():
            head.append(f"\n{text}" if s.flags & flag else "", style="yellow")
    return Group(head, contact_table(listener.rows(now_ns), links))
