"""`skinbus monitor`: the contacts that a master publishes, live; a listener like any other CANopen tool."""

from __future__ import annotations

import time

import click

from skinbus.cli.console import Console
from skinbus.cli.options import Where, bus_options, seconds_option
from skinbus.cli.output import echo
from skinbus.cli.stop_signals import Ending
from skinbus.config.system import load_arm
from skinbus.skin.listened import listen
from skinbus.view.screen import REFRESH_S, Screen, live_screen

SILENT_S = 1.0
"""A master that was not heard for so long has gone."""


@click.command()
@click.argument("arm")
@bus_options
@seconds_option
def command(arm: str, where: Where, seconds: float | None) -> None:
    """Show the contacts that a master of ARM publishes, until Ctrl-C; status 1 when no master sent anything.

    Pressures are computed from the readings of the patches; their zeros are found here. Without a terminal
    the screen is printed once, at the end. Programs use `skinbus.listen`.

    \b
    Examples:
      skinbus monitor forearm --channel can0
      skinbus monitor arm-two-buses -c upper=can0 -c lower=can1
    """
    loaded, newest, console = load_arm(arm, check_load=False), None, Console()
    end_s = time.monotonic() + seconds if seconds else float("inf")
    with (
        Ending() as ending,
        listen(loaded, **where.words(), readings=True) as skin,
        live_screen(console, loaded) as show,
    ):
        while time.monotonic() < end_s and not ending.asked:
            newest = skin.get(REFRESH_S) or newest
            show(newest if newest and newest.age_s < SILENT_S else None)
    if newest is None:
        echo("nothing of a master was received: does one run on this bus?", err=True)
        raise SystemExit(1)
    if not console.is_terminal:
        console.print(Screen(loaded).render(newest))
