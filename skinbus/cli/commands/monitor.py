"""`skinbus monitor`: the contacts that a master publishes, live; a listener like any other CANopen tool."""

from __future__ import annotations

import json
import time

import click

from skinbus.cli.console import Console
from skinbus.cli.options import Where, bus_options, seconds_option
from skinbus.cli.output import echo
from skinbus.cli.recorded import values_of
from skinbus.cli.stop_signals import Ending
from skinbus.config.system import load_arm
from skinbus.skin.cycle import Cycle
from skinbus.skin.listened import listen
from skinbus.view.screen import REFRESH_S, Screen, live_screen

SILENT_S = 1.0
"""A master that has sent nothing for so long has gone."""


@click.command()
@click.argument("arm")
@bus_options
@click.option(
    "--json-lines",
    "is_stream",
    is_flag=True,
    help="Print a line of JSON for every cycle; its contacts have the columns of `export`.",
)
@seconds_option
def command(arm: str, where: Where, is_stream: bool, seconds: float | None) -> None:
    """Show the contacts that a master of ARM publishes, until Ctrl-C; status 1 when no master sent anything.

    Pressures are computed from the readings of the patches; their zeros are found here. Without a terminal
    the screen is printed once, at the end.

    \b
    Examples:
      skinbus monitor forearm --channel can0
      skinbus monitor arm-two-buses -c upper=can0 -c lower=can1
      skinbus monitor forearm --json-lines | jq -c .contacts
    """
    loaded, newest, console = load_arm(arm, check_load=False), None, Console()
    end_s = time.monotonic() + seconds if seconds else float("inf")
    with (
        Ending() as ending,
        listen(loaded, **where.words(), readings=not is_stream) as skin,
        live_screen(console, loaded, is_wanted=not is_stream) as show,
    ):
        while time.monotonic() < end_s and not ending.asked:
            if cycle := skin.get(REFRESH_S):
                newest = cycle
                if is_stream:
                    echo(line_of(cycle))
            show(_still(newest))
    if newest is None:
        echo("nothing of a master was received: does one run on this bus?", err=True)
        raise SystemExit(1)
    if not (is_stream or console.is_terminal):
        console.print(Screen(loaded).render(_still(newest)))


def _still(cycle: Cycle | None) -> Cycle | None:
    """Return a cycle unless its master has gone since."""
    return cycle if cycle and cycle.age_s < SILENT_S else None


def line_of(cycle: Cycle) -> str:
    """Return a cycle as JSON; contacts have the columns of docs/export.md."""
    values = {
        "sync": cycle.counter,
        "latency_us": round(1e6 * cycle.latency_s),
        "level": cycle.level,
        "flags": [flag.name.lower() for flag in cycle.flags if flag.name],
        "contacts": [*map(values_of, cycle.contacts)],
    }
    return json.dumps(values)
