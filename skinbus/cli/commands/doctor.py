"""`skinbus doctor`: is this machine fit to run a master, and what is to be done where it is not."""

from __future__ import annotations

import grp
import json
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from importlib import resources
from itertools import chain
from pathlib import Path

import click

import skinbus
from skinbus.cli import diagnostics as checks
from skinbus.cli.commands.health import STATE, not_commissioned
from skinbus.cli.commands.scan import candidates_of
from skinbus.cli.diagnostics import Finding
from skinbus.cli.formatting import counted, span
from skinbus.cli.host import Host
from skinbus.cli.options import buses_options, file_option, json_option
from skinbus.cli.output import JsonFile, echo
from skinbus.cli.state_keeper import health_file, load_health
from skinbus.config.arm_file import read_arm_file
from skinbus.config.system import load_arm, ods_of
from skinbus.errors import BusError, ConfigError
from skinbus.master.commissioning.scan import Found, Scanner, match
from skinbus.master.health import findings
from skinbus.master.patches.provisioning import expected_node
from skinbus.model import Arm, BusSettings
from skinbus.skin.addresses import BusAddress, find_places, interface_of
from skinbus.skin.shared_object import MAX_NAME, path_of

POLL_S = 0.05
MASTER_EDS = "skin-master"
UNIT_ARM = "/etc/skinbus/arm.toml"
"""What the unit runs by default."""

HOMES = (Path("/home"), Path("/root"), Path("/run/user"))
"""What ProtectHome hides."""


@click.command()
@click.argument("arm", required=False)
@buses_options
@file_option(
    "--state",
    help="State of the master of ARM, for the health of tactels; by default that of the service, if any.",
)
@click.option("--unit", is_flag=True, help="Print the systemd unit of the master for this installation.")
@click.option(
    "--share", metavar="NAME", help="Of --unit: the name of its shared memory, by default that of ARM."
)
@json_option
def command(
    arm: str | None,
    interface: str | None,
    channels: tuple[str, ...],
    bitrate: int | None,
    state: Path | None,
    unit: bool,
    share: str | None,
    json_file: JsonFile | None,
) -> None:
    """Check interface, bit rate, queues, permissions, clock, caches, and the nodes of ARM on the bus.

    Nothing is changed but damaged entries of the kernels' cache, which are removed. Status 1 when there is
    something to do, 2 when there is no such arm or interface.

    \b
    Examples:
      skinbus doctor my-arm.toml --channel can0
      skinbus doctor /etc/skinbus/arm.toml --unit > /etc/systemd/system/skinbus-master.service
      skinbus doctor my-arm.toml -c upper=can0 -c lower=can1 --unit
    """
    if unit:
        echo(unit_text(arm, interface, channels, bitrate, share), nl=False)
        return
    if share is not None:
        raise click.UsageError("--share needs --unit")
    findings = []
    for finding in chain(examine(arm, interface, channels, bitrate), check_health(arm, state)):
        findings.append(finding)
        echo(f"{'fix' if finding.advice else 'ok ':4} {finding.check:20} {finding.found}")
        if finding.advice:
            echo(f"{'':25} -> {finding.advice}")
    if json_file:
        json_file.write([finding.as_row() for finding in findings])
    n = sum(bool(finding.advice) for finding in findings)
    echo(f"{counted(n, 'thing')} to do" if n else "all is well")
    sys.exit(1 if n else 0)


def examine(
    name: str | None, interface: str | None, channels: tuple[str, ...], bitrate: int | None
) -> Iterator[Finding]:
    """Return the findings, one check after the other."""
    arm = None
    if name:
        try:
            arm = load_arm(name)
            yield from checks.check_arm(arm)
        except ConfigError as error:
            if not Path(name).exists():
                raise  # a slip of the keyboard; nothing of what follows was meant
            yield Finding(check="arm", found=str(error), advice="mend the file")
    buses = arm.buses if arm else (BusSettings(),)
    lacking = [bus for bus in buses if bus.channel is None] if len(buses) > 1 and not channels else []
    for bus in lacking:
        advice = f"--channel {bus.name}=..., or channel in its [[bus]]"
        yield Finding(check="channel", found=f"none for bus {bus.name}", advice=advice)
        interface_of(bus, interface)  # one that there is not is refused all the same
    numbers = [k for k, bus in enumerate(buses) if bus not in lacking]
    places = find_places([buses[k] for k in numbers], interface, channels, bitrate) if numbers else []
    can_open = []
    for place in places:
        if place.interface == "socketcan":
            findings = list(checks.check_interface(place))
            yield from findings
            if any(finding.check == "interface" and finding.advice for finding in findings):
                can_open.append(False)  # no user can, and the reason is known
                continue
        opened = list(checks.check_open(place))
        yield from opened
        can_open.append(not opened[0].advice)
    yield from checks.check_priority()
    yield from checks.check_clock()
    yield from checks.check_cache()
    for k, place, is_open in zip(numbers, places, can_open, strict=True):
        if is_open:
            yield from check_nodes(arm.part(k) if arm else None, place)


def check_health(name: str | None, state: Path | None) -> Iterator[Finding]:
    """Did tactels of the arm change since they were commissioned?"""
    if name is None or (state is None and not health_file(STATE).path.exists()):
        return
    try:
        arm = load_arm(name)
        boards = load_health(arm, state or STATE)
    except ConfigError as error:
        yield Finding(check="health", found=str(error), advice="see the message")
        return
    found = findings(arm, boards)
    for own in found:
        which = f"tactels {span(own.tactels)}: " if own.tactels else ""
        check = f"node {arm.node_id[own.patch]}"
        yield Finding(check=check, found=which + own.what, advice=own.advice)
    if not found:
        n = sum(board is not None for board in boards)
        same = f"{counted(n, 'board')} as at commissioning"
        yield Finding(check="health", found=not_commissioned(arm, boards) or same)


def check_nodes(arm: Arm | None, place: BusAddress) -> Iterator[Finding]:
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
    yield from judge_nodes(arm, [node for _, node in sorted(scanner.nodes.items())])
    if scanner.has_unconfigured:
        yield Finding(check="node-ID", found="a node has none yet", advice="skinbus scan assign gives it one")
    if arm is not None and n:
        missing = sorted(set(arm.node_id.tolist()) - set(scanner.nodes))
        if missing:
            yield Finding(check="missing nodes", found=span(missing), advice="check their cable and node-ID")


def judge_nodes(arm: Arm | None, nodes: Sequence[Found]) -> Iterator[Finding]:
    """Say which nodes are not what the EDS of their patch says, and which no file names."""
    candidates = list(candidates_of(None))
    ods = ods_of(arm) if arm else []
    strangers: list[int] = []
    for node in nodes:
        check = f"node {node.node_id}"
        names = match(node, candidates).names
        if not node.answers:
            advice = "a node that is stopped is silent; see its state: skinbus scan"
            yield Finding(check=check, found="answers no SDO", advice=advice)
        elif arm is None:
            if not names:
                advice = "wrong device, or its EDS file is not known here: skinbus scan --eds FOLDER"
                yield Finding(check=check, found="fits no EDS", advice=advice)
        elif node.node_id not in arm.node_id:
            if MASTER_EDS not in names:
                strangers.append(node.node_id)
        else:
            p = arm.patch_at(node.node_id)
            wanted = asdict(expected_node(node.node_id, ods[p]).identity)
            wrong = [name for name, value in wanted.items() if value and node.numbers.get(name) != value]
            if wrong:
                eds = arm.patches[p].eds
                seen = ", ".join(f"{name} {_hex(node.numbers.get(name))}" for name in wrong)
                due = ", ".join(_hex(wanted[name]) for name in wrong)
                advice = f"put the right board there, or its EDS in the arm file: {eds} has {due}"
                if names:
                    advice += f"; this one fits {', '.join(names)}"
                yield Finding(check=check, found=seen.replace("_", " "), advice=advice)
    if strangers:
        advice = "not in the arm file: take them off the bus, or name them there"
        yield Finding(check="other nodes", found=", ".join(map(str, strangers)), advice=advice)


def _hex(number: int | None) -> str:
    return "unknown" if number is None else f"0x{number:X}"


def unit_text(
    arm: str | None = None,
    interface: str | None = None,
    channels: Sequence[str] = (),
    bitrate: int | None = None,
    share: str | None = None,
) -> str:
    """Return the systemd unit, with the path of this installation and the arguments of the master."""
    template = resources.files("skinbus.cli").joinpath("skinbus-master.service").read_text()
    file = Path(arm).resolve() if arm and Path(arm).exists() else None
    words = ["run", str(file) if file else arm or UNIT_ARM]
    if arm is not None:
        find_places(load_arm(arm).buses, interface, channels, bitrate)  # refused here, not at every start
    words += ["--interface", interface] if interface else []
    words += [word for channel in channels for word in ("--channel", channel)]
    words += ["--bitrate", str(bitrate)] if bitrate else []
    needed = [Path(sys.prefix), Path(skinbus.__file__), *(read_arm_file(file).files if file else ())]
    if share is None:
        share = re.sub(r"[^A-Za-z0-9_.-]", "-", Path(arm or UNIT_ARM).stem)[:MAX_NAME]
    path_of(share)  # refused here, not at every start
    # An installation at home is not visible to a service without access to homes.
    at_home = any(path.is_relative_to(home) for path in needed for home in HOMES)
    program = Path(sys.executable).parent / "skinbus"
    values = {
        "@COMMAND@": " ".join(_word(word) for word in [str(program), *words, "--quiet", "--wait"])
        + f" --state %S/skinbus/state --share {share}",
        "@WARM@": f"{_word(str(program))} warm",
        "@HOME@": "read-only" if at_home else "yes",
        **_sandbox(interface or "socketcan"),
    }
    for name, value in values.items():
        template = template.replace(name, value)
    return template


def _sandbox(interface: str) -> dict[str, str]:
    """Return what the unit has to allow for an interface."""
    if interface == "socketcan":
        families, network, devices = "AF_CAN AF_UNIX", "IPAddressDeny=any\n", None
    elif interface == "udp_multicast":
        allowed = "IPAddressDeny=any\nIPAddressAllow=localhost multicast\n"
        families, network, devices = "AF_INET AF_INET6 AF_UNIX AF_NETLINK", allowed, None
    else:  # an adapter that python-can opens as a serial port, a USB or a character device
        families, network = "AF_UNIX AF_NETLINK", "IPAddressDeny=any\n"
        here = {group.gr_name for group in grp.getgrall()}
        groups = " ".join(group for group in ("dialout", "plugdev", "uucp") if group in here)
        devices = f"DeviceAllow=char-* rw\nSupplementaryGroups={groups}\n"
    return {
        "@FAMILIES@": families,
        "@NETWORK@": network,
        "@PRIVATE_DEVICES@": "no" if devices else "yes",
        "@DEVICES@": devices or "",
    }


def _word(word: str) -> str:
    """Return a word of a command as systemd reads it."""
    word = word.replace("%", "%%").replace("$", "$$")
    if word.isprintable() and word and not set(word) & set(" \"'\\;"):
        return word
    return json.dumps(word)
