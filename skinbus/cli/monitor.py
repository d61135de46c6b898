"""`skinbus monitor`: the contacts that a master publishes, live; a listener like any other CANopen tool."""

from __future__ import annotations

import json
import time
from contextlib import closing
from dataclasses import asdict

import click
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from skinbus.bus.clock import MonotonicClock
from skinbus.cli.options import bus_options, json_option, seconds_option
from skinbus.cli.places import find_place
from skinbus.view.latency import LatencyLog, bars
from skinbus.view.listener import Listener
from skinbus.view.table import contact_table

POLL_S = 0.1
"""Frames are looked at ten times a second: what eyes can follow."""

HISTOGRAM_ROWS, HISTOGRAM_WIDTH = 16, 50
"""Fits below the table of contacts on a terminal of 80 x 40."""


@click.command()
@bus_options
@click.option(
    "--node-id", default=127, show_default=True, type=click.IntRange(1, 127), help="Node-ID of the master."
)
@click.option("--latency", "shows_latency", is_flag=True, help="Also show how old contacts are: a histogram.")
@seconds_option
@json_option
def command(
    interface: str | None,
    channel: str | None,
    bitrate: int | None,
    node_id: int,
    shows_latency: bool,
    seconds: float | None,
    json_file: str | None,
) -> None:
    """Show the contacts that a master publishes, until Ctrl-C; exit status 1 when no master was heard.

    \b
    Examples:
      skinbus monitor --channel can0
      skinbus monitor --channel can0 --latency
      skinbus monitor --interface udp_multicast --channel 239.74.163.2 --seconds 5 --json contacts.json
    """
    clock = MonotonicClock()
    listener = Listener(node_id)
    latency = LatencyLog(node_id)
    with (
        closing(find_place(interface, channel, bitrate).open()) as bus,
        Live(console=Console(), refresh_per_second=10) as live,
    ):
        end = time.monotonic() + seconds if seconds else float("inf")
        try:
            while time.monotonic() < end:
                frames = [frame for frame in bus.receive(POLL_S) if not frame.flags]
                listener.step(clock.now_ns(), frames)
                latency.take(frames)
                live.update(_screen(listener, clock.now_ns(), latency if shows_latency else None))
        except KeyboardInterrupt:
            pass
    if json_file:
        _write(listener, latency, clock.now_ns(), json_file)
    if not listener.n_summaries:
        click.echo(f"no master was heard: does one run on this bus, with node-ID {node_id}?", err=True)
        raise SystemExit(1)


def _screen(listener: Listener, now_ns: int, latency: LatencyLog | None) -> Group:
    """Return what is shown: the summary line, the table of contacts, and the histogram if it is wanted."""
    rows = listener.rows(now_ns)
    if listener.summary is None or now_ns - listener.last_heard_ns > 1_000_000_000:
        head = Text("waiting for a master ...", style="yellow")
    else:
        s = listener.summary
        head = Text(
            f"SYNC {s.counter:3d}   patches {s.alive}   contacts {s.n_contacts}   "
            f"compute {s.compute_us} us   latency {s.latency_us / 1e3:.1f} ms"
        )
    if latency is None:
        return Group(head, contact_table(rows))
    return Group(head, contact_table(rows), Text("\n".join(_histogram(latency))))


def _histogram(latency: LatencyLog) -> list[str]:
    """Return the lines on latency: percentiles, and the histogram from touch to contact."""
    if latency.n_cycles == 0:
        return ["", "latency: no contact yet"]
    lines = [""]
    for name, bins in (("SYNC", latency.sync_to_contact), ("touch", latency.touch_to_contact)):
        if spread := latency.spread(bins):
            lines.append(
                f"{name:>5} to contact, ms: p50 {spread.p50:.1f}  p95 {spread.p95:.1f}  "
                f"p99 {spread.p99:.1f}  max {spread.max:.1f}  ({latency.n_cycles} cycles)"
            )
    return lines + bars(latency.touch_to_contact, HISTOGRAM_ROWS, HISTOGRAM_WIDTH)


def _write(listener: Listener, latency: LatencyLog, now_ns: int, json_file: str) -> None:
    rows = [
        {"id": r.id, "link": r.link, "state": r.state.name.lower(), "s": r.s, "a": r.a, "force": r.force}
        for r in listener.rows(now_ns)
    ]
    both = {"sync_to_contact": latency.sync_to_contact, "touch_to_contact": latency.touch_to_contact}
    ages = {name: asdict(spread) for name, bins in both.items() if (spread := latency.spread(bins))}
    with open(json_file, "w") as file:
        json.dump({"cycles": listener.n_summaries, "contacts": rows, "latency_ms": ages}, file, indent=1)
        file.write("\n")
