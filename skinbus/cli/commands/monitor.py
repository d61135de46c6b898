"""`skinbus monitor`: the contacts that a master publishes, live; a listener like any other CANopen tool."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, nullcontext
from dataclasses import asdict

import click
from rich.console import Group
from rich.live import Live
from rich.text import Text

from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.can.clock import Clock
from skinbus.can.frame import Frame
from skinbus.cli.console import Console
from skinbus.cli.options import DEFAULT_BITRATE, buses_options, json_option, seconds_option
from skinbus.cli.output import JsonFile, echo
from skinbus.cli.stop_signals import Ending
from skinbus.config.system import load_arm
from skinbus.master.level_control import CycleFlags
from skinbus.model import Arm, BusSettings
from skinbus.skin.addresses import BusAddress, channels_by_name, find_places
from skinbus.skin.listener import Listener, why_not_of
from skinbus.view.latency import LatencyLog
from skinbus.view.table import contact_table

POLL_S = 0.1
"""Frames are looked at ten times a second: what eyes can follow."""

DOUBTS = {
    CycleFlags.INCOMPLETE: "not all patches have readings proven to be of this SYNC: 0x2300 shows which",
    CycleFlags.IMPAIRED: "tactels are not plausible and count as missing: 0x2305 shows which",
}
"""What is said of a cycle by its flags; the numbers are objects of the master."""


@click.command()
@click.argument("arm", required=False)
@buses_options
@click.option(
    "--node-id", default=127, show_default=True, type=click.IntRange(1, 127), help="Node-ID of the master."
)
@click.option("--latency", "shows_latency", is_flag=True, help="Also show how old contacts are.")
@click.option(
    "--json-lines", "is_stream", is_flag=True, help="Instead of the screen, a line of JSON for every cycle."
)
@seconds_option
@json_option
def command(
    arm: str | None,
    interface: str | None,
    channels: tuple[str, ...],
    bitrate: int | None,
    node_id: int,
    shows_latency: bool,
    is_stream: bool,
    seconds: float | None,
    json_file: JsonFile | None,
) -> None:
    """Show the contacts that a master publishes, until Ctrl-C; exit status 1 when no master sent anything.

    With ARM (a name or a TOML file) links have their names; the bus carries numbers only. Exit
    status 1, too, when what was sent cannot be of ARM. Where there is no terminal, the screen is shown
    once, at the end.

    \b
    Examples:
      skinbus monitor --channel can0
      skinbus monitor forearm --channel can0 --latency
      skinbus monitor arm-two-buses -c upper=can0 -c lower=can1
      skinbus monitor forearm --json-lines | jq -c .contacts
      skinbus monitor --interface udp_multicast --channel 239.74.163.2 --seconds 5 --json contacts.json
    """
    loaded = load_arm(arm, check_load=False) if arm else None
    links = tuple(link.name for link in loaded.links) if loaded else ()
    place = place_of(loaded, interface, channels, bitrate)
    clock = MonotonicClock()
    listener = Listener(node_id)
    latency = LatencyLog(node_id)
    why_not: str | None = None
    console = Console()
    is_live = console.is_terminal and not is_stream
    with (
        Ending() as ending,
        closing(place.open()) as bus,
        Live(console=console, refresh_per_second=10) if is_live else nullcontext() as live,
    ):
        end = time.monotonic() + seconds if seconds else float("inf")
        while time.monotonic() < end and not ending.asked:
            frames = [frame for frame in bus.receive(POLL_S) if not frame.flags]
            latency.take(frames)
            if is_stream:
                for line in cycles(listener, clock, frames, links):
                    echo(json.dumps(line))
            else:
                listener.step(clock.now_ns(), frames)
            if loaded and frames and not why_not:
                why_not = why_not_of(loaded, listener.summary, listener.rows(clock.now_ns()))
            if live:
                live.update(_screen(listener, clock.now_ns(), latency if shows_latency else None, links))
    if not is_stream and not live:
        console.print(_screen(listener, clock.now_ns(), latency if shows_latency else None, links))
    if json_file:
        json_file.write(
            {
                "cycles": listener.n_summaries,
                "contacts": rows_of(listener, clock.now_ns(), links),
                "latency_ms": _ages(latency),
            }
        )
    if not listener.n_summaries:
        echo(f"nothing of a master was received: does one run on this bus, with node-ID {node_id}?", err=True)
    if why_not:
        echo(f"this master is not of {arm}, or of another version of its file: {why_not}", err=True)
    if why_not or not listener.n_summaries:
        raise SystemExit(1)


def place_of(
    arm: Arm | None, interface: str | None, channels: Sequence[str], bitrate: int | None
) -> BusAddress:
    """Return the first bus that has a channel: contacts are published on all buses of an arm."""
    buses = arm.buses if arm else (BusSettings(bitrate=DEFAULT_BITRATE),)
    said = channels_by_name(buses, channels)
    k = next((k for k, bus in enumerate(buses) if said[k] or (bus.channel and not channels)), 0)
    return find_places(buses[k : k + 1], interface, [said[k] or ""] if said[k] else (), bitrate)[0]


def cycles(
    listener: Listener, clock: Clock, frames: Sequence[Frame], links: Sequence[str]
) -> Iterator[dict[str, object]]:
    """Take frames; return a row for programs of each cycle that they end.

    A cycle's summary comes before its contacts, so it is over when the next one's summary comes.
    """
    for frame in frames:
        before, n = listener.summary, listener.n_summaries
        now_ns = clock.now_ns()
        rows = rows_of(listener, now_ns, links) if before and frame.can_id == listener.summary_id else []
        listener.step(now_ns, [frame])
        if before and listener.n_summaries > n:
            yield {
                "sync": before.counter,
                "patches_alive": before.alive,
                "compute_us": before.compute_us,
                "latency_us": before.latency_us,
                "level": before.level,
                "flags": [flag.name.lower() for flag in before.flags if flag.name],
                "contacts": rows,
            }


def rows_of(listener: Listener, now_ns: int, links: Sequence[str]) -> list[dict[str, object]]:
    """Return the contacts shown now for a program, rounded to the resolution of their TPDO."""
    return [
        {
            "id": row.id,
            "link": links[row.link] if row.link < len(links) else row.link,
            "state": row.state.name.lower(),
            "s_mm": round(1e3 * row.s, 1),
            "a_mm": round(1e3 * row.a, 1),
            "force_n": round(row.force, 2),
        }
        for row in listener.rows(now_ns)
    ]


def _screen(listener: Listener, now_ns: int, latency: LatencyLog | None, links: tuple[str, ...]) -> Group:
    """Return what is shown: the summary line, the table of contacts, and latencies if they are wanted."""
    rows = listener.rows(now_ns)
    if listener.summary is None or now_ns - listener.last_heard_ns > 1_000_000_000:
        head = Text("waiting for a master ...", style="yellow")
    else:
        s = listener.summary
        head = Text(
            f"SYNC {s.counter:3d}   patches {s.alive}   contacts {s.n_contacts}   "
            f"compute {s.compute_us} us   latency {s.latency_us / 1e3:.1f} ms"
            + (f"   level {s.level}" if s.level else "")
        )
        for flag, text in DOUBTS.items():
            if s.flags & flag:
                head.append(f"\n{text}", style="yellow")
    if latency is None:
        return Group(head, contact_table(rows, links))
    return Group(head, contact_table(rows, links), Text("\n".join(_latencies(latency))))


def _latencies(latency: LatencyLog) -> list[str]:
    """Return the percentiles of latency as lines."""
    if latency.n_cycles == 0:
        return ["", "latency: no contact yet"]
    lines = [""]
    for name, bins in (("SYNC", latency.sync_to_contact), ("touch", latency.touch_to_contact)):
        if spread := latency.spread(bins):
            lines.append(
                f"{name:>5} to contact, ms: p50 {spread.p50:.1f}  p95 {spread.p95:.1f}  "
                f"p99 {spread.p99:.1f}  max {spread.max:.1f}  ({latency.n_cycles} cycles)"
            )
    return lines


def _ages(latency: LatencyLog) -> dict[str, dict[str, float]]:
    """Return how old contacts are, for a program."""
    both = {"sync_to_contact": latency.sync_to_contact, "touch_to_contact": latency.touch_to_contact}
    return {name: asdict(spread) for name, bins in both.items() if (spread := latency.spread(bins))}
