"""`skinbus sim`: the patches of a scene on a CAN bus."""

from __future__ import annotations

import click

from skinbus.cli.host import Host
from skinbus.cli.options import Where, arm_bus_options, seconds_option
from skinbus.cli.output import echo
from skinbus.config.system import ods_of
from skinbus.formatting import counted
from skinbus.sim import World, load_scene
from skinbus.skin.addresses import bus_numbers, shown

SCAN_NS = 10_000_000
"""Patches whose last three samples are late do not guard: a process without priority is late by some ms."""


@click.command()
@click.argument("scene")
@arm_bus_options
@seconds_option
def command(
    scene: str,
    where: Where,
    seconds: float | None,
) -> None:
    """Simulate the patches of SCENE (a name or a TOML file) on a CAN bus, until Ctrl-C.

    For an arm file the scene is a fingertip that presses some boards of the arm, one after the other.

    With --bus only the patches on these buses are simulated. The scene starts at the first SYNC of a
    master and repeats.

    \b
    Examples:
      skinbus sim forearm --channel vcan0
      skinbus sim my-scene.toml --interface udp_multicast --channel 239.74.163.2 --seconds 30
      skinbus sim arm-two-buses -c upper=vcan0 -c lower=vcan1
    """
    played = load_scene(scene)
    arm = played.arm
    numbers = bus_numbers(arm, where.names)
    places = where.places(*(arm.buses[k] for k in numbers))
    world = World(played, ods_of(arm), repeat=True, buses=numbers, scan_ns=SCAN_NS)
    # A collection of all that a world of 126 patches is made of takes half a second: five cycles.
    host = Host(world, places, steady=True)
    n = len(world.devices)
    echo(f"{played.name}: {counted(n, 'patch')} of {arm.name} on {shown(places)}; Ctrl-C stops")
    with host:
        host.wait(seconds)
    echo(f"{host.report.n_received} frames in, {host.report.n_sent} out")
