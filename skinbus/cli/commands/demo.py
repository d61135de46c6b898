"""`skinbus demo`: simulated patches and a master on a virtual clock, contacts live beside the truth."""

from __future__ import annotations

import click
import numpy as np

from skinbus.cli.console import Console
from skinbus.cli.host import compiling
from skinbus.cli.options import level_option
from skinbus.cli.stop_signals import Ending
from skinbus.estimate import TrackState
from skinbus.formatting import counted
from skinbus.sim import load_scene
from skinbus.skin.contact import Level
from skinbus.skin.cycle import Cycle
from skinbus.skin.simulated import simulate
from skinbus.view.screen import live_screen

GATE = 0.020
"""m; a contact further than this from a touch is not that touch: two tactels of the default board."""


@click.command()
@click.argument("scene", default="forearm")
@level_option()
def command(scene: str, level: Level) -> None:
    """Show the whole pipeline in one process: simulated patches, CAN buses, the master, contacts and truth.

    Bus and patches run on a virtual clock, so every machine gets the same contacts. In a terminal the
    scene is played in real time. At the end it says how far contacts were from the truth.

    \b
    Examples:
      skinbus demo
      skinbus demo arm --level full
    """
    played = load_scene(scene)
    console, errors, n_cycles = Console(), list[tuple[float, float]](), 0
    with compiling(console):
        skin = simulate(played, level=level, zero=played.begins_untouched, realtime=console.is_terminal)
    patches = counted(played.arm.n_patches, "patch")
    console.print(f"{played.name}: {patches} at {played.arm.bus.rate_hz:g} Hz, {played.duration_s:g} s")
    with Ending() as ending, skin, live_screen(console, played.arm) as show:
        for cycle in skin:
            n_cycles += 1
            errors += errors_of(cycle)
            show(cycle)
            if ending.asked:
                break
    place, force = np.array(errors).reshape(-1, 2).T
    near = place < GATE
    found = f"{counted(len(place), 'touch')}, {near.sum()} of them with a contact within 20 mm"
    console.print(f"{counted(n_cycles, 'cycle')} with {found}")
    if near.any():
        mm, percent = 1e3 * np.median(place[near]), 100.0 * np.median(force[near])
        console.print(f"median error: place {mm:.2f} mm, force {percent:.1f} %")


def errors_of(cycle: Cycle) -> list[tuple[float, float]]:
    """Return errors of place (m) and force (a part) of the contact nearest to each touch; inf without one."""
    seen = [contact for contact in cycle.contacts if contact.state not in (TrackState.COAST, TrackState.LIFT)]
    return [
        min(
            (
                (float(np.linalg.norm(contact.point - touch.point)), abs(contact.force / touch.force - 1.0))
                for contact in seen
                if contact.link == touch.link
            ),
            default=(np.inf, np.inf),
        )
        for touch in cycle.truth
    ]
