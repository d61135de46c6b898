"""`skinbus sim`: the patches of a scene on a CAN bus."""

from __future__ import annotations

import click

from skinbus.bus.interface import open_interface
from skinbus.cli.host import Host
from skinbus.cli.options import bus_options, seconds_option
from skinbus.objects.arm import ods_of
from skinbus.sim import World, load_scene


@click.command()
@click.argument("scene")
@bus_options
@seconds_option
def command(
    scene: str, interface: str, channel: str | None, bitrate: int | None, seconds: float | None
) -> None:
    """Simulate the patches of SCENE (a name or a TOML file) on a CAN bus, until Ctrl-C.

    Scene time starts with the first SYNC that a master sends, and the scene is played over and over.

    \b
    Examples:
      skinbus sim forearm --channel vcan0
      skinbus sim my-scene.toml --interface udp_multicast --channel 239.74.163.2 --seconds 30
    """
    played = load_scene(scene)
    arm = played.arm
    world = World(played, ods_of(arm), repeat=True)
    speed = bitrate or arm.bus.bitrate
    # A collection of all that a world of 126 patches is made of takes half a second: five cycles.
    host = Host(world, lambda: open_interface(interface, channel, bitrate=speed), steady=True)
    click.echo(f"{played.name}: {arm.n_patches} patches of {arm.name} on {interface}; Ctrl-C stops")
    with host:
        host.wait(seconds)
    click.echo(f"{host.report.n_received} frames in, {host.report.n_sent} out")
