"""`skinbus monitor`: the contacts that a master publishes, live; a listener like any other CANopen tool."""

from __future__ import annotations

import json
import time

import click
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from skinbus.bus.clock import MonotonicClock
from skinbus.bus.pythoncan import PythonCanBus
from skinbus.cli.options import DEFAULT_BITRATE, bus_options, json_option, seconds_option
from skinbus.view.listener import Listener
from skinbus.view.table import contact_table

POLL_S = 0.1
"""Frames are looked at ten times a second: what eyes can follow."""


@click.command()
@bus_options
@click.option(
    "--node-id", default=127, show_default=True, type=click.IntRange(1, 127), help="Node-ID of the master."
)
@seconds_option
@json_option
def command(
    interface: str,
    channel: str | None,
    bitrate: int | None,
    node_id: int,
    seconds: float | None,
    json_file: str | None,
) -> None:
    """Show the contacts that a master publishes, until Ctrl-C.

    \b
    Examples:
      skinbus monitor --channel can0
      skinbus monitor --interface udp_multicast --channel 239.74.163.2 --seconds 5 --json contacts.json
    """
    clock = MonotonicClock()
    listener = Listener(node_id)
    end = time.monotonic() + seconds if seconds else float("inf")
    with (
        PythonCanBus(interface, channel, bitrate=bitrate or DEFAULT_BITRATE) as bus,
        Live(console=Console(), refresh_per_second=10) as live,
    ):
        try:
            while time.monotonic() < end:
                frames = bus.receive(POLL_S)
                listener.step(clock.now_ns(), frames)
                live.update(_screen(listener, clock.now_ns()))
        except KeyboardInterrupt:
            pass
    if json_file:
        _write(listener, clock.now_ns(), json_file)


def _screen(listener: Listener, now_ns: int) -> Group:
    """Return what is shown: the summary line and the table of contacts."""
    rows = listener.rows(now_ns)
    if listener.summary is None or now_ns - listener.last_heard_ns > 1_000_000_000:
        head = Text("waiting for a master ...", style="yellow")
    else:
        s = listener.summary
        head = Text(
            f"SYNC {s.counter:3d}   patches {s.alive}   contacts {s.n_contacts}   "
            f"compute {s.compute_us} us   latency {s.latency_us / 1e3:.1f} ms"
        )
    return Group(head, contact_table(rows))


def _write(listener: Listener, now_ns: int, json_file: str) -> None:
    rows = [
        {"id": r.id, "link": r.link, "state": r.state.name.lower(), "s": r.s, "a": r.a, "force": r.force}
        for r in listener.rows(now_ns)
    ]
    with open(json_file, "w") as file:
        json.dump({"cycles": listener.n_summaries, "contacts": rows}, file, indent=1)
        file.write("\n")
