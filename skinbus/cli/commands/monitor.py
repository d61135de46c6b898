"""`skinbus monitor`: the contacts that a master publishes, live; a listener like any other CANopen tool."""

from __future__ import annotations

import json
import time
from contextlib import nullcontext
from typing import Any, Final

import click
from rich.live import Live

from skinbus.cli.console import Console
from skinbus.cli.host import REFRESH_S
from skinbus.cli.options import BusesWords, buses_options, seconds_option
from skinbus.cli.output import echo
from skinbus.cli.stop_signals import Ending
from skinbus.config.system import load_arm
from skinbus.skin.cycle import Cycle
from skinbus.skin.listened import listen
from skinbus.view.screen import Screen

SILENT_S: Final = 1.0
"""A master that was not heard for so long has gone."""


@click.command()
@click.argument("arm")
@buses_options
@click.option("--json-lines", "is_stream", is_flag=True, help="Print a line of JSON for every cycle instead.")
@seconds_option
def command(arm: str, where: BusesWords, is_stream: bool, seconds: float | None) -> None:
    """Show the contacts that a master of ARM publishes, until Ctrl-C; status 1 when no master sent anything.

    Pressures are computed from the readings of the patches; their zeros are found here. Without a terminal
    the screen is printed once, at the end.

    \b
    Examples:
      skinbus monitor forearm --channel can0
      skinbus monitor arm-two-buses -c upper=can0 -c lower=can1
      skinbus monitor forearm --json-lines | jq -c .contacts
    """
    loaded, newest, shown_s = load_arm(arm, check_load=False), None, 0.0
    console, screen, (interface, channel, bitrate) = Console(), Screen(loaded), where
    is_live = console.is_terminal and not is_stream
    with (
        Ending() as ending,
        listen(loaded, interface=interface, channel=channel, bitrate=bitrate, readings=not is_stream) as skin,
        Live(console=console, auto_refresh=False) if is_live else nullcontext() as live,
    ):
        end_s = time.monotonic() + seconds if seconds else float("inf")
        while (now_s := time.monotonic()) < end_s and not ending.asked:
            if cycle := skin.get(REFRESH_S):
                newest = cycle
                if is_stream:
                    echo(json.dumps(values_of(cycle)))
            if live and now_s >= shown_s + REFRESH_S:
                shown_s = now_s
                heard = newest if newest and newest.age_s < SILENT_S else None
                live.update(screen.render(heard, *console.size), refresh=True)
    if newest is None:
        echo("nothing of a master was received: does one run on this bus?", err=True)
        raise SystemExit(1)
    if not is_live and not is_stream:
        console.print(screen.render(newest))


def values_of(cycle: Cycle) -> dict[str, Any]:
    """Return a cycle for programs, rounded to the resolution of its TPDOs."""
    return {
        "sync": cycle.counter,
        "latency_us": round(1e6 * cycle.latency_s),
        "level": cycle.level,
        "flags": [flag.name.lower() for flag in cycle.flags if flag.name],
        "contacts": [
            {
                "id": one.id,
                "link": one.link,
                "state": one.state.name.lower(),
                "s_mm": round(1e3 * one.s, 1),
                "a_mm": round(1e3 * one.a, 1),
                "force_n": round(one.force, 2),
            }
            for one in cycle.contacts
        ],
    }
