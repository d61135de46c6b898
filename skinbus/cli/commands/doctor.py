"""`skinbus doctor`: is this machine fit to run a master, and what is to be done where it is not."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from skinbus.bus.monotonic_clock import sharpen_timers
from skinbus.bus.socketcan_batch import CANFD_MTU
from skinbus.cli.options import Where, bus_options
from skinbus.cli.output import echo
from skinbus.config.arm_file import find_arm
from skinbus.config.system import load_arm
from skinbus.errors import BusError
from skinbus.formatting import counted
from skinbus.model import BusSettings
from skinbus.robot.chain import check_robot
from skinbus.skin.addresses import BusAddress
from skinbus.skin.shared_memory import name_for

UNIT_ARM = "/etc/skinbus/arm.toml"
"""What the unit runs by default."""


MIN_QUEUE = 64
"""Frames the send queue should hold: a cycle's 17 contact frames, and SDO to many patches at once."""

LATE_US = 500
"""A wake-up that is later than this is a twentieth of a cycle at 100 Hz."""

N_SLEEPS = 300


@click.command()
@click.argument("arm", required=False)
@bus_options
@click.option("--unit", is_flag=True, help="Print the systemd unit of the master for this installation.")
def command(arm: str | None, where: Where, unit: bool) -> None:
    """Check the file of ARM, interface, bit rate, queue, permissions and wake-ups.

    `skinbus scan` and `skinbus configure --dry-run` check the boards.

    Nothing is changed. Status 1 when there is something to do, 2 when the arm file has faults, python-can
    does not know --interface, or a bus has no channel.

    \b
    Examples:
      skinbus doctor my-arm.toml -c can0
      skinbus doctor /etc/skinbus/arm.toml --unit > /etc/systemd/system/skinbus-master.service
    """
    if unit:
        if any(where):
            raise click.UsageError("the unit is for SocketCAN and the channels of the arm file")
        echo(unit_text(arm), nl=False)
        return
    n = 0
    for finding in examine(arm, where):
        n += finding.is_wrong
        echo(f"{'fix' if finding.is_wrong else 'ok ':4} {finding.check:20} {finding.found}")
        if finding.is_wrong:
            echo(f"{'':25} -> {finding.advice}")
    echo(f"{counted(n, 'thing')} to do" if n else "all is well")
    sys.exit(1 if n else 0)


class Finding(NamedTuple):
    """One check's outcome; ``advice`` is for when it is wrong."""

    check: str
    found: str
    is_wrong: bool = False
    advice: str = ""


def check_interface(place: BusAddress) -> Iterator[Finding]:
    """Is a SocketCAN interface there, up, healthy, at the arm's bit rates; does its queue hold a cycle?"""
    channel, known = str(place.channel), _links()
    if channel not in known:
        there = f"CAN interfaces here: {', '.join(known)}" if known else "load the adapter's driver"
        other = "; without CAN in the kernel, try --interface udp_multicast"
        yield Finding("interface", f"{channel} does not exist or is no CAN interface", True, there + other)
        return
    link = known[channel]
    info, queue, is_up = link.get("linkinfo", {}), link.get("txqlen", 0), "UP" in link["flags"]
    settings = "" if info.get("info_kind") in ("vcan", "vxcan") else f" {_settings(place)}"
    up = f"ip link set {channel} up{settings}"
    yield Finding("interface", f"{channel} is {'up' if is_up else 'down'}", not is_up, up)
    if info.get("info_kind") == "can":
        yield from check_controller(place, info.get("info_data", {}))
    if place.data_bitrate:
        how = f"ip link set {channel} down; ip link set {channel} mtu {CANFD_MTU}; {up}"
        yield Finding("CAN FD", f"mtu {link['mtu']}", link["mtu"] < CANFD_MTU, how)
    longer = f"ip link set {channel} txqueuelen 128"
    yield Finding("send queue", f"{queue} frames" if queue else "unlimited", 0 < queue < MIN_QUEUE, longer)


def check_controller(place: BusAddress, data: dict[str, Any]) -> Iterator[Finding]:
    """Check bit rates, state and restart of a real controller."""
    again = f"ip link set {place.channel} down; ip link set {place.channel} up {_settings(place)}"
    for kind, key, wanted in (
        ("bit rate", "bittiming", place.bitrate),
        ("data bit rate", "data_bittiming", place.data_bitrate),
    ):
        # ip(8) has two places for it: controllers with a table of bit rates, as slcan, are in the second.
        actual = data.get(key, {}).get("bitrate") or data.get(f"{key}_bitrate")
        if wanted:
            yield Finding(kind, f"{actual or 'unknown'} bit/s", bool(actual) and actual != wanted, again)
    state, restart = data.get("state", "unknown"), data.get("restart_ms", 0)
    wiring = "check wiring, both 120 ohm terminators, and the bit rate of all nodes"
    yield Finding("controller", state, state in ("BUS-OFF", "ERROR-PASSIVE"), wiring)
    yield Finding("bus-off", f"restarts after {restart} ms" if restart else "stays off", not restart, again)


def check_open(place: BusAddress) -> Iterator[Finding]:
    """May this user open the interface?"""
    try:
        place.open().close()
        yield Finding("permission", f"{place} can be opened")
    except BusError as error:
        yield Finding("permission", str(error), True, "see the message")


def check_machine() -> Iterator[Finding]:
    """May this user have real-time priority, and does a sleep end in time?"""
    is_allowed = resource.getrlimit(resource.RLIMIT_RTPRIO)[0] != 0 or os.geteuid() == 0
    service = "run it as the service that `skinbus doctor --unit` prints"
    found = "allowed" if is_allowed else "not allowed for this user"
    yield Finding("real-time priority", found, not is_allowed, service)
    sharpen_timers()
    late_us = []
    for _ in range(N_SLEEPS):
        begin = time.monotonic()
        time.sleep(1e-3)
        late_us.append(1e6 * (time.monotonic() - begin - 1e-3))
    p99 = np.percentile(late_us, 99)
    how = f"{service}, end other work, set the CPU to `performance` (cpupower), or take a PREEMPT_RT kernel"
    yield Finding("wake-ups", f"late by {p99:.0f} us (p99)", bool(p99 >= LATE_US), how)


def _settings(place: BusAddress) -> str:
    """The arguments of ip(8) for a controller."""
    fd = f" dbitrate {place.data_bitrate} fd on" if place.data_bitrate else ""
    return f"type can bitrate {place.bitrate}{fd} restart-ms 100"


def _links() -> dict[str, dict[str, Any]]:
    """What ip(8) reports of the CAN interfaces, by name; nothing without it."""
    try:
        answer = subprocess.run(
            ["ip", "-details", "-json", "link", "show"], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return {}
    return {link["ifname"]: link for link in json.loads(answer.stdout) if link["link_type"] == "can"}


def examine(name: str | None, where: Where) -> Iterator[Finding]:
    """Return the findings, one check after the other."""
    buses: Sequence[BusSettings] = ()
    if name:
        arm = check_robot(load_arm(name))
        buses = arm.buses
        speeds = " and ".join(f"{bus.bitrate // 1000} kbit/s" for bus in buses)
        patches = f"{counted(arm.n_patches, 'patch')} at {arm.bus.rate_hz:g} Hz"
        yield Finding("arm", f"{arm.name}: {patches}, {speeds}")
    for place in where.places(*buses):
        found = list(check_interface(place)) if place.interface == "socketcan" else []
        yield from found
        if not (found and found[0].is_wrong):
            yield from check_open(place)
    yield from check_machine()


def unit_text(arm: str | None = None) -> str:
    """Return the systemd unit of the master of an arm, with the path of this installation."""
    if arm:
        check_robot(load_arm(arm))  # refused here, not at every start
    file = str(find_arm(arm).resolve()) if arm else UNIT_ARM
    program = _word(str(Path(sys.executable).parent / "skinbus"))
    run = f"{program} run {_word(file)} --quiet --state %S/skinbus/state --share {name_for(file)}"
    template = resources.files("skinbus.cli").joinpath("skinbus-master.service").read_text()
    return template.replace("@COMMAND@", run).replace("@WARM@", f"{program} doctor warm")


def _word(word: str) -> str:
    """Return a word of a command as systemd reads it."""
    return json.dumps(word.replace("%", "%%").replace("$", "$$"))
