"""`skinbus gateway`: a skin that is not CANopen as patches on a CANopen bus."""

from __future__ import annotations

import click

from skinbus.cli.host import Host
from skinbus.cli.options import Where, seconds_option
from skinbus.cli.output import echo
from skinbus.config.system import load_arm, ods_of
from skinbus.errors import AddressError
from skinbus.formatting import counted
from skinbus.gateway.frame_format import format_names, load_format
from skinbus.gateway.gateway import Gateway
from skinbus.skin.addresses import shown


@click.command(epilog=f"Formats that ship: {', '.join(format_names())}.")
@click.argument("format_name", metavar="FORMAT")
@click.argument("arm_name", metavar="ARM")
@click.option("--from", "skin", required=True, help="Channel that the skin is on; no CANopen device may be.")
@click.option("--to", "canopen", required=True, help="Channel of the CANopen bus.")
@click.option(
    "--interface", help="python-can interface of both: socketcan (default), udp_multicast, slcan, ..."
)
@seconds_option
def command(
    format_name: str,
    arm_name: str,
    skin: str,
    canopen: str,
    interface: str | None,
    seconds: float | None,
) -> None:
    """Send the readings of a skin that is not CANopen as CANopen patches, until Ctrl-C.

    FORMAT describes its frames: a name or a TOML file. In the arm file, each patch that the skin reads has an
    address, such as "2.5" for triangle 5 of board 2. For a master these patches are like any others.

    \b
    Examples:
      skinbus gateway icub-mtb4 upper-arm.toml --from can1 --to can0
      skinbus gateway my-skin.toml my-arm.toml --from can1 --to can0
      skinbus gateway icub-mtb4 arm.toml --interface udp_multicast --from 239.74.163.3 --to 239.74.163.2
    """
    found, arm = load_format(format_name), load_arm(arm_name)
    gateway = Gateway(found, arm, ods_of(arm))
    places = [
        Where(interface, (channel,), bitrate).places()[0]
        for channel, bitrate in ((canopen, arm.bus.bitrate), (skin, found.bitrate))
    ]
    if places[0][:2] == places[1][:2]:  # skins use identifiers of PDOs and NMT
        raise AddressError(f"--from and --to are both {places[0]}; the skin needs a bus of its own")
    host = Host(
        gateway,
        places,
        urgent=True,  # as boards are: a master that computes must not make their readings late
    )
    n = counted(len(gateway.node_ids), "patch")
    echo(f"{found.title}: {n} of {arm.name} from {shown(places[1:])} to {shown(places[:1])}; Ctrl-C stops")
    with host:
        host.wait(seconds)
    echo(f"{counted(gateway.receiver.n_foreign, 'frame')} on {skin} were of no patch")
