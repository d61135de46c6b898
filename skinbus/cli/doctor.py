"""`skinbus doctor`: is this machine fit to run a master, and what is to be done where it is not."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import click

from skinbus.cli import checks
from skinbus.cli.checks import Finding
from skinbus.cli.host import Host
from skinbus.cli.options import buses_options, json_option
from skinbus.cli.places import Place, find_places
from skinbus.cli.scan import candidates_of
from skinbus.errors import BusError, ConfigError
from skinbus.master.scan import Scanner, match
from skinbus.model import Arm, BusSettings
from skinbus.objects.arm import load_arm

POLL_S = 0.05


@click.command()
@click.argument("arm", required=False)
@buses_options
@click.option("--unit", is_flag=True, help="Print the systemd unit of the master for this installation.")
@json_option
def command(
    arm: str | None,
    interface: str | None,
    channels: tuple[str, ...],
    bitrate: int | None,
    unit: bool,
    json_file: str | None,
) -> None:
    """Check interface, bit rate, queues, permissions, clock, caches, and the nodes of ARM on the bus.

    Nothing is changed. Status 1 when there is something to do, 2 when there is no such arm.

    \b
    Examples:
      skinbus doctor my-arm.toml --channel can0
      skinbus doctor --unit > /etc/systemd/system/skinbus-master.service
    """
    if unit:
        click.echo(unit_text(), nl=False)
        return
    findings = []
    for finding in examine(arm, interface, channels, bitrate):
        findings.append(finding)
        click.echo(f"{'fix' if finding.advice else 'ok ':4} {finding.check:20} {finding.found}")
        if finding.advice:
            click.echo(f"{'':25} -> {finding.advice}")
    if json_file:
        Path(json_file).write_text(json.dumps([finding.as_row() for finding in findings], indent=1) + "\n")
    n = sum(bool(finding.advice) for finding in findings)
    click.echo(f"{n} thing{'' if n == 1 else 's'} to do" if n else "all is well")
    sys.exit(1 if n else 0)


def examine(
    name: str | None, interface: str | None, channels: tuple[str, ...], bitrate: int | None
) -> Iterator[Finding]:
    """Return the findings, one check after the other."""
    arm = None
    if name:
        try:
            arm = load_arm(name)
            yield from checks.check_load(arm)
        except ConfigError as error:
            if not Path(name).exists():
                raise  # a slip of the keyboard; nothing of what follows was meant
            yield Finding(check="arm", found=str(error), advice="mend the file")
    places = find_places(arm.buses if arm else (BusSettings(),), interface, channels, bitrate)
    can_open = []
    for place in places:
        if place.interface == "socketcan":
            findings = list(checks.check_interface(place))
            yield from findings
            if any(finding.check == "interface" and finding.advice for finding in findings):
                can_open.append(False)  # nobody can, and it is known why
                continue
        opened = list(checks.check_open(place))
        yield from opened
        can_open.append(not opened[0].advice)
    yield from checks.check_priority()
    yield from checks.check_clock()
    yield from checks.check_cache()
    for k, place in enumerate(places):
        if can_open[k]:
            yield from check_nodes(arm.part(k) if arm else None, place)


def check_nodes(arm: Arm | None, place: Place) -> Iterator[Finding]:
    """Are the nodes of the arm on its one bus, and are they what their EDS files say?"""
    scanner = Scanner()
    try:
        with Host(scanner, place.open, say=lambda text: None) as host:
            host.wait(None, POLL_S)
    except BusError as error:
        yield Finding(check="nodes", found=str(error), advice="see the message")
        return
    n = len(scanner.nodes)
    power = "are they powered, terminated, at this bit rate? see: skinbus scan"
    where = f"bus {arm.bus.name}" if arm and arm.bus.name else "the bus"
    yield Finding(check="nodes", found=f"{n} on {where}", advice="" if n else power)
    candidates = list(candidates_of(None))
    for node_id, node in sorted(scanner.nodes.items()):
        found = match(node, candidates)
        if not found.names and (arm is None or node_id in arm.node_id):
            advice = "wrong device, or its EDS file is not known here: skinbus scan --eds FOLDER"
            yield Finding(check=f"node {node_id}", found="fits no EDS", advice=advice)
    if arm is not None and n:
        missing = sorted(set(arm.node_id.tolist()) - set(scanner.nodes))
        if missing:
            text = ", ".join(map(str, missing))
            yield Finding(check="missing nodes", found=text, advice="check their cable and node-ID")


def unit_text() -> str:
    """Return the systemd unit, with the path of this installation."""
    template = resources.files("skinbus.cli").joinpath("skinbus-master.service").read_text()
    program = Path(sys.executable).parent / "skinbus"
    return template.replace("@SKINBUS@", str(program))
